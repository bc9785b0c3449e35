//! The graph of stages as SVG: inputs above what reads them, edges around the stages that they pass.
//!
//! Layers by the longest way from a stage without inputs, order within a layer by the mean place of neighbours
//! (Sugiyama, Tagawa and Toda, IEEE Trans. SMC 11, 109 (1981)); an edge over several layers has a place in each.

use std::fmt::Write;

use crate::preview::chart::svg::escaped;

use super::page::{Edge, Node};

const WIDTH: f64 = 168.0;
const HEIGHT: f64 = 46.0;
const GAP: f64 = 18.0;
const RISE: f64 = 40.0;
/// What an edge takes that passes a layer.
const LANE: f64 = 14.0;
const SWEEPS: usize = 8;
/// More stages than this are listed in the table alone.
pub const MOST: usize = 80;

/// A stage, or the place where an edge passes a layer.
#[derive(Clone, Copy)]
struct Item {
    node: Option<usize>,
    layer: usize,
    /// Left end.
    x: f64,
}

impl Item {
    fn width(&self) -> f64 {
        if self.node.is_some() { WIDTH } else { LANE }
    }

    fn middle(&self) -> f64 {
        self.x + self.width() / 2.0
    }
}

/// The picture; none without stages or with more than [`MOST`].
pub fn svg(nodes: &[Node], edges: &[Edge]) -> Option<String> {
    if nodes.is_empty() || nodes.len() > MOST {
        return None;
    }
    let layers = layers(nodes.len(), edges);
    let mut items: Vec<Item> =
        layers.iter().enumerate().map(|(node, &layer)| Item { node: Some(node), layer, x: 0.0 }).collect();
    // The items that each edge passes, its ends with them.
    let mut ways: Vec<Vec<usize>> = Vec::new();
    for edge in edges {
        let mut way = vec![edge.from];
        for layer in layers[edge.from] + 1..layers[edge.to] {
            way.push(items.len());
            items.push(Item { node: None, layer, x: 0.0 });
        }
        way.push(edge.to);
        ways.push(way);
    }
    let depth = layers.iter().max().map_or(0, |last| last + 1);
    let rows = order(&items, &ways, depth);
    let span = |row: &Vec<usize>| row.iter().map(|&i| items[i].width()).sum::<f64>() + GAP * (row.len() as f64 - 1.0);
    let spans: Vec<f64> = rows.iter().map(span).collect();
    let widest = spans.iter().copied().fold(0.0, f64::max);
    for (row, span) in rows.iter().zip(spans) {
        let mut x = (widest - span) / 2.0;
        for &i in row {
            items[i].x = x;
            x += items[i].width() + GAP;
        }
    }
    let (width, height) = (widest + 8.0, depth as f64 * (HEIGHT + RISE) - RISE + 8.0);
    let top = |layer: usize| 4.0 + layer as f64 * (HEIGHT + RISE);
    let mut svg = String::new();
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"graph\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-labelledby=\"graph-title\">\n<title id=\"graph-title\">The stages and how they feed each other; the table below says the same</title>\n"
    );
    for (edge, way) in edges.iter().zip(&ways) {
        let mut d = String::new();
        for pair in way.windows(2) {
            let (from, to) = (&items[pair[0]], &items[pair[1]]);
            let (x0, y0) = (from.middle() + 4.0, top(from.layer) + HEIGHT);
            let (x1, y1) = (to.middle() + 4.0, top(to.layer));
            let bend = (y1 - y0) / 2.0;
            let start = if d.is_empty() { format!("M{x0:.1} {y0:.1}") } else { format!("V{y0:.1}") };
            let _ = write!(d, "{start}C{x0:.1} {:.1} {x1:.1} {:.1} {x1:.1} {y1:.1}", y0 + bend, y1 - bend);
        }
        let _ = writeln!(svg, "<path class=\"edge\" d=\"{d}\"><title>{}</title></path>", escaped(&edge.ports));
    }
    for item in &items {
        let Some(node) = item.node.map(|node| &nodes[node]) else { continue };
        let (x, y) = (item.x + 4.0, top(item.layer));
        let times = if node.instances == 1 { String::new() } else { format!(" × {}", node.instances) };
        let name = clipped(&node.name, 22_usize.saturating_sub(times.chars().count()));
        let _ = writeln!(
            svg,
            "<g class=\"node {}\"><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"5\"/><text x=\"{:.1}\" y=\"{:.1}\" class=\"name\">{}{times}</text><text x=\"{:.1}\" y=\"{:.1}\">{} · {}</text></g>",
            node.state.class(),
            x + WIDTH / 2.0,
            y + 20.0,
            escaped(&name),
            x + WIDTH / 2.0,
            y + 37.0,
            escaped(&node.kind),
            node.state.text()
        );
    }
    svg.push_str("</svg>");
    Some(svg)
}

/// For each node the longest way to it. Stages come in any order, and never feed themselves.
fn layers(nodes: usize, edges: &[Edge]) -> Vec<usize> {
    let mut layers = vec![0; nodes];
    for _ in 0..nodes {
        let before = layers.clone();
        edges.iter().for_each(|edge| layers[edge.to] = layers[edge.to].max(layers[edge.from] + 1));
        if layers == before {
            break;
        }
    }
    layers
}

/// The items of each layer from left to right.
fn order(items: &[Item], ways: &[Vec<usize>], depth: usize) -> Vec<Vec<usize>> {
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); depth];
    items.iter().enumerate().for_each(|(i, item)| rows[item.layer].push(i));
    let mut neighbours: Vec<[Vec<usize>; 2]> = vec![Default::default(); items.len()];
    for pair in ways.iter().flat_map(|way| way.windows(2)) {
        neighbours[pair[1]][0].push(pair[0]);
        neighbours[pair[0]][1].push(pair[1]);
    }
    let mut place = vec![0.0; items.len()];
    let settle = |row: &[usize], place: &mut Vec<f64>| {
        let middle = (row.len() as f64 - 1.0) / 2.0;
        row.iter().enumerate().for_each(|(k, &i)| place[i] = k as f64 - middle);
    };
    rows.iter().for_each(|row| settle(row, &mut place));
    for sweep in 0..SWEEPS {
        let side = sweep % 2;
        for k in 0..depth {
            let row = &mut rows[if side == 0 { k } else { depth - 1 - k }];
            let mean = |i: usize| {
                let next = &neighbours[i][side];
                if next.is_empty() { place[i] } else { next.iter().map(|&n| place[n]).sum::<f64>() / next.len() as f64 }
            };
            row.sort_by(|&a, &b| mean(a).total_cmp(&mean(b)));
            settle(row, &mut place);
        }
    }
    rows
}

fn clipped(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::super::page::NodeState;
    use super::*;

    fn node(name: &str) -> Node {
        Node { name: name.into(), kind: "render".into(), instances: 1, state: NodeState::ToRun }
    }

    fn edge(from: usize, to: usize) -> Edge {
        Edge { from, to, ports: "frames".into() }
    }

    /// Inputs stand above what reads them, also where the file has them in another order; a long edge passes beside the stages between.
    #[test]
    fn inputs_stand_above() {
        let edges = [edge(2, 0), edge(0, 1), edge(2, 1), edge(1, 3), edge(2, 3)];
        assert_eq!(layers(4, &edges), [1, 2, 0, 3]);
        let svg = svg(&["b", "c", "a", "d"].map(node), &edges).unwrap();
        assert_eq!(svg.matches("<rect").count(), 4);
        // Ways of 1, 1, 2, 1 and 3 bends.
        assert_eq!(svg.matches('C').count(), 8);
    }

    #[test]
    fn names_are_text() {
        let svg = svg(&[node("<script>&\"")], &[]).unwrap();
        assert!(svg.contains("&lt;script&gt;&amp;&quot;") && !svg.contains("<script"), "{svg}");
        assert!(super::svg(&[], &[]).is_none());
    }

    /// Crossings that the order can avoid are avoided.
    #[test]
    fn edges_do_not_cross_without_need() {
        let edges = [edge(0, 3), edge(1, 2)];
        let svg = svg(&["a", "b", "c", "d"].map(node), &edges).unwrap();
        let at = |name: &str| svg.find(&format!(">{name}<")).unwrap();
        // Boxes are drawn by number; the order shows in x: read it off the rectangles.
        let x: Vec<f64> =
            svg.split("<rect x=\"").skip(1).map(|t| t.split('"').next().unwrap().parse().unwrap()).collect();
        assert!(at("a") < at("b") && (x[0] < x[1]) == (x[3] < x[2]), "{x:?}");
    }
}
