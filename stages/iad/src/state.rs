//! What a slab does to light as an instrument sees it, with its derivatives.

use crate::forward::{Plan, Response};
use crate::spheres::Seen;

#[derive(Clone, Copy)]
pub struct State {
    pub seen: Seen,
    pub absorbed: f64,
    /// Absorbed in the slides.
    pub slides: f64,
}

/// What a slab of mu_a d, mu_s' d does.
pub fn state<const M: usize>(plan: &Plan<M>, flipped: Option<&Plan<M>>, [a, s]: [f64; 2]) -> Option<State> {
    let r = plan.respond(plan.depths_of(a, s))?;
    let below = match flipped {
        None => r.uru,
        Some(plan) => plan.respond(plan.depths_of(a, s))?.uru,
    };
    let slides = if has_dark_slides(plan) { (1.0 - r.ut1) - r.ur1 - r.absorbed } else { 0.0 };
    Some(State::new(&r, below, slides))
}

/// The same with its derivatives.
pub fn state_with_slopes_per_depth<const M: usize>(
    plan: &Plan<M>,
    flipped: Option<&Plan<M>>,
    [a, s]: [f64; 2],
) -> Option<(State, [State; 2])> {
    let (r, slopes) = plan.respond_with_slopes(plan.depths_of(a, s))?;
    let (below, below_slopes) = match flipped {
        None => (r.uru, slopes.map(|s| s.uru)),
        Some(plan) => {
            let (r, slopes) = plan.respond_with_slopes(plan.depths_of(a, s))?;
            (r.uru, slopes.map(|s| s.uru))
        }
    };
    let dark = has_dark_slides(plan);
    let slides = if dark { (1.0 - r.ut1) - r.ur1 - r.absorbed } else { 0.0 };
    let slopes = std::array::from_fn(|i| {
        let s = &slopes[i];
        State::new(s, below_slopes[i], if dark { -s.ut1 - s.ur1 - s.absorbed } else { 0.0 })
    });
    Some((State::new(&r, below, slides), slopes))
}

/// At the logarithms of both depths, with the derivatives by these.
pub fn state_with_slopes<const M: usize>(
    plan: &Plan<M>,
    flipped: Option<&Plan<M>>,
    x: [f64; 2],
) -> Option<(State, [State; 2])> {
    let depths = x.map(libm::exp);
    let (state, slopes) = state_with_slopes_per_depth(plan, flipped, depths)?;
    Some((state, std::array::from_fn(|i| slopes[i].times(depths[i]))))
}

fn has_dark_slides<const M: usize>(plan: &Plan<M>) -> bool {
    plan.slab().top.tau > 0.0 || plan.slab().bottom.tau > 0.0
}

impl State {
    fn new(r: &Response, uru_below: f64, slides: f64) -> Self {
        let seen = Seen {
            beam: [r.ur1, r.ut1],
            unscattered: [r.ur1_unscattered, r.ut1_unscattered],
            uru: [r.uru, uru_below],
            utu: r.utu,
        };
        Self { seen, absorbed: r.absorbed, slides }
    }

    fn times(&self, h: f64) -> Self {
        let Seen { beam, unscattered, uru, utu } = self.seen;
        let [beam, unscattered, uru] = [beam, unscattered, uru].map(|pair| pair.map(|x| h * x));
        Self {
            seen: Seen { beam, unscattered, uru, utu: h * utu },
            absorbed: h * self.absorbed,
            slides: h * self.slides,
        }
    }

    /// `h` along `slope`.
    pub fn moved(&self, slope: &Self, h: f64) -> Self {
        let by = slope.times(h);
        let pair = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
        Self {
            seen: Seen {
                beam: pair(self.seen.beam, by.seen.beam),
                unscattered: pair(self.seen.unscattered, by.seen.unscattered),
                uru: pair(self.seen.uru, by.seen.uru),
                utu: self.seen.utu + by.seen.utu,
            },
            absorbed: self.absorbed + by.absorbed,
            slides: self.slides + by.slides,
        }
    }
}
