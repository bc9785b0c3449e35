use std::collections::BTreeSet;

use super::*;

/// A random graph of stages over the axes a, b, c, each node fed by nodes before it whose axes it takes over or gathers; and
/// the small generator behind it.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }

    fn links(&mut self) -> Links {
        let sizes: Vec<u64> = (0..3).map(|_| 1 + self.below(5)).collect();
        let mut nodes: Vec<(usize, Vec<u32>, Vec<Feed>)> = Vec::new();
        let mut stages: Vec<(Vec<bool>, Range<usize>)> = Vec::new();
        for stage in 0..2 + self.below(7) as usize {
            // An ordinary input brings its axes, a gathered one those that no other brings.
            let ordinary: Vec<usize> = (0..stage).filter(|_| self.below(3) == 0).collect();
            let gathered: Vec<usize> = (0..stage).filter(|s| self.below(6) == 0 && !ordinary.contains(s)).collect();
            let mut has = vec![false; 3];
            for source in &ordinary {
                (0..3).for_each(|axis| has[axis] |= stages[*source].0[axis]);
            }
            let adds = self.below(5) as usize;
            if adds < 3 {
                has[adds] = true;
            }
            let begin = nodes.len();
            let count = |axis: usize| if has[axis] { sizes[axis] as u32 } else { 1 };
            for at in 0..count(0) * count(1) * count(2) {
                let place = [at / count(2) / count(1), at / count(2) % count(1), at % count(2)];
                let point: Vec<u32> = (0..3).map(|axis| if has[axis] { place[axis] + 1 } else { 0 }).collect();
                let agrees = |node: usize| nodes[node].1.iter().zip(&point).all(|(a, b)| *a == 0 || *b == 0 || a == b);
                let of = |sources: &[usize]| -> Vec<usize> {
                    sources.iter().flat_map(|s| stages[*s].1.clone()).filter(|&node| agrees(node)).collect()
                };
                let plain = of(&ordinary).into_iter().map(|node| Feed { node, gathered: false });
                let many = of(&gathered);
                let many = many.iter().map(|&node| Feed { node, gathered: many.len() > 1 });
                let feeds = plain.chain(many).collect();
                nodes.push((stage, point, feeds));
            }
            stages.push((has, begin..nodes.len()));
        }
        Links::of_test(&nodes)
    }
}

fn sets(split: &Split) -> Vec<BTreeSet<usize>> {
    (1..=split.of).map(|number| split.nodes(Shard { number, of: split.of }).into_iter().collect()).collect()
}

/// Of random graphs and numbers of shards: together the shards run everything but what is left, none runs what is left, each
/// runs what feeds it, what is left gathers from several shards or follows from what is left, what two shards run feeds
/// something in each of them that is theirs, and the chain of what a shard was dealt is in it as a whole.
#[test]
fn shards_are_whole_and_together_everything_but_the_gathers() {
    let mut random = Random(1);
    let (mut left, mut shared, mut several) = (0, 0, 0);
    for case in 0..600 {
        let links = random.links();
        let of = 1 + random.below(9) as u32;
        let split = Split::of_links(links.clone(), of);
        let sets = sets(&split);
        let union: BTreeSet<usize> = sets.iter().flatten().copied().collect();
        assert_eq!(union.len() + split.left(), links.len(), "case {case}");
        left += split.left();
        several += usize::from(sets.iter().filter(|set| !set.is_empty()).count() > 1);
        if of == 1 {
            assert_eq!(split.left(), 0, "case {case}");
        }
        let owners = |node: usize| sets.iter().filter(|set| set.contains(&node)).count();
        let chains = chains(&links, &joins(&links, of), &chained(&links, &joins(&links, of)));
        for node in 0..links.len() {
            let feeds = || links.feeds(node);
            match split.homes[node] {
                Home::Left => {
                    assert!(!union.contains(&node), "case {case}: {node} is left and runs");
                    let follows = feeds().any(|feed| split.homes[feed.node] == Home::Left);
                    // No shard holds all of its sources ..
                    let held = sets.iter().any(|set| feeds().all(|feed| set.contains(&feed.node)));
                    assert!(follows || !held, "case {case}: {node} is left without need");
                }
                Home::Shard(own) => {
                    assert!(sets[own as usize].contains(&node), "case {case}: {node}");
                    let whole = |other: usize| chains[other] != chains[node] || split.homes[other] == Home::Shard(own);
                    assert!((0..links.len()).all(whole), "case {case}: the chain of {node} is cut");
                }
                Home::Shared => shared += usize::from(owners(node) > 1),
            }
            for (at, set) in sets.iter().enumerate().filter(|(_, set)| set.contains(&node)) {
                assert!(feeds().all(|feed| set.contains(&feed.node)), "case {case}: {node} lacks what feeds it");
                let feeds_one = |other: &usize| links.feeds(*other).any(|feed| feed.node == node);
                let is_own = split.homes[node] == Home::Shard(at as u32);
                assert!(is_own || set.iter().any(feeds_one), "case {case}: {node} runs in {at} for nothing");
            }
        }
    }
    assert!(left > 0 && shared > 0 && several > 100, "the cases say something: {left} {shared} {several}");
}

/// The order in which a node names what feeds it says nothing.
#[test]
fn the_split_does_not_depend_on_the_order_of_sources() {
    let mut random = Random(2);
    for _ in 0..100 {
        let links = random.links();
        let nodes = |turned: bool| -> Vec<_> {
            let node = |node: usize| {
                let mut feeds: Vec<Feed> = links.feeds(node).collect();
                if turned {
                    feeds.reverse();
                }
                (links.stages[node], links.values[links.points[node]].to_vec(), feeds)
            };
            (0..links.len()).map(node).collect()
        };
        let [a, b] = [false, true].map(|turned| sets(&Split::of_links(Links::of_test(&nodes(turned)), 4)));
        assert_eq!(a, b);
    }
}

/// A chain of three stages at each of `points`, where one producer feeds the whole first stage; `gather` sums the last one up,
/// and `after` follows from that.
fn sweep(points: u32, repeats: u32) -> Links {
    let feed = |node: usize| Feed { node, gathered: false };
    let mut nodes = vec![(0, vec![0, 0], Vec::new())];
    for (at, (a, b)) in (1..=points).flat_map(|a| (1..=repeats).map(move |b| (a, b))).enumerate() {
        let first = 1 + 2 * at;
        nodes.push((1, vec![a, b], vec![feed(0)]));
        nodes.push((2, vec![a, b], vec![feed(first)]));
    }
    let all: Vec<usize> = (0..(points * repeats) as usize).map(|at| 2 + 2 * at).collect();
    for (at, ends) in all.chunks(repeats as usize).enumerate() {
        let feeds = ends.iter().map(|&node| Feed { node, gathered: repeats > 1 }).collect();
        nodes.push((3, vec![at as u32 + 1, 0], feeds));
    }
    let means = nodes.len() - points as usize..nodes.len();
    nodes.push((4, vec![0, 0], means.map(|node| Feed { node, gathered: true }).collect()));
    nodes.push((5, vec![0, 0], vec![feed(nodes.len() - 1)]));
    Links::of_test(&nodes)
}

/// Equal blocks of neighbouring points; the mean over the repeats of a point is its own, the sum over all points is left, and
/// so is what follows from it; the producer of all is in each shard.
#[test]
fn points_are_dealt_in_blocks() {
    let links = sweep(16, 3);
    let split = Split::of_links(links.clone(), 8);
    assert_eq!(split.left(), 2);
    for (at, set) in sets(&split).iter().enumerate() {
        let points: BTreeSet<u32> = set.iter().map(|&node| links.values[links.points[node]][0]).collect();
        let first = 2 * at as u32;
        assert_eq!(points, BTreeSet::from([0, first + 1, first + 2]), "shard {at}");
        assert_eq!(set.len(), 1 + 2 * (2 * 3 + 1));
    }
    // More shards than points: repeats apart, so that each has one chain at most, and the means are left.
    let split = Split::of_links(links.clone(), 48);
    assert!(sets(&split).iter().all(|set| set.len() == 3));
    assert_eq!(split.left(), 16 + 2);
    let split = Split::of_links(links, 100);
    assert_eq!(sets(&split).iter().filter(|set| set.is_empty()).count(), 100 - 48);
}

#[test]
fn shards_are_written_k_of_n() {
    assert_eq!("3/8".parse(), Ok(Shard { number: 3, of: 8 }));
    let wrong = |text: &str| text.parse::<Shard>().unwrap_err();
    assert!(wrong("0/8").contains("count from 1") && wrong("9/8").contains("1/8 to 8/8"));
    assert!(wrong("1/0").contains("one shard at least"));
    for (count, of) in [(0, 3), (1, 4), (7, 3), (64, 8), (10, 64)] {
        let blocks: Vec<_> = (1..=of).map(|number| Shard { number, of }.block(count)).collect();
        assert!(blocks.iter().all(|block| (count / of as usize..=count.div_ceil(of as usize)).contains(&block.len())));
        assert_eq!(blocks.into_iter().flatten().collect::<Vec<_>>(), (0..count).collect::<Vec<_>>());
    }
    for text in ["a/b", "", "3", "-1/8", "1/8/2", "1/99999999999", "1.0/2"] {
        assert!(wrong(text).contains("K/N"), "{text}");
    }
}
