//! What the projector shows, frame by frame: sinusoids, or the layers of a pattern. And how frames follow from what paths bring.

use std::f64::consts::TAU;

use turbid_contract::payload::{Pattern, Projector};
use turbid_contract::{Error, Layer, LayerInfo, LayerKind};
use turbid_optics::elementary::sin_cos_turns;

use crate::light::Carrier;
use crate::params::Params;
use crate::projected_images::ProjectedImages;
use crate::response::{Layout, ONE};

/// Weights of responses, by their places.
pub type Terms = Vec<(usize, f64)>;

/// What is shown, and what to make of the responses to it.
pub struct Projected {
    pub carriers: Vec<Carrier>,
    pub projected_images: ProjectedImages,
    pub layout: Layout,
    /// Every frame: what its layer says, and the responses that it is the sum of.
    pub frames: Vec<(LayerInfo, Terms)>,
    /// Behind the frames of the covariance port: dc, re and im.
    pub quantities: Vec<Quantity>,
}

/// A quantity that frames are made of: see the payload `Covariance`.
pub struct Quantity {
    pub part: &'static str,
    pub f_x_per_mm: f64,
    pub orientation_deg: f64,
    pub terms: Terms,
}

impl Projected {
    /// The sinusoids of the params: frame = L(1)/2 + Re(e^{i phase} L(e^{i 2 pi f_x u}))/2 and the steady light, so of the responses
    /// (1, re, im, steady) the weights (1/2, cos(phase)/2, -sin(phase)/2, 1).
    pub fn sinusoids(params: &Params, steady: bool) -> Self {
        let carriers = params.carriers();
        let layout = Layout { carriers: carriers.len(), projected_images: 0, steady };
        let with_steady = |mut terms: Terms| {
            terms.extend(layout.steady().map(|i| (i, 1.0)));
            terms
        };
        let dc = with_steady(vec![(ONE, 0.5)]);
        let mut frames = Vec::new();
        let mut places = 0..carriers.len();
        for f in &params.f_x {
            let mut info = LayerInfo::value("radiance", "").with_f_x(f.0);
            if f.0 == 0.0 {
                info.phase_rad = Some(0.0);
                frames.push((info, dc.clone()));
                continue;
            }
            for o in &params.orientation_deg {
                info.orientation_deg = Some(o.0);
                let re = layout.re(places.next().expect("one carrier for each f_x > 0 and orientation"));
                for k in 0..params.phases {
                    let turns = f64::from(k) / f64::from(params.phases);
                    info.phase_rad = Some(TAU * turns);
                    let (sin, cos) = sin_cos_turns(turns);
                    let terms = with_steady(vec![(ONE, 0.5), (re, 0.5 * cos), (re + 1, -0.5 * sin)]);
                    frames.push((info.clone(), terms));
                }
            }
        }
        let quantity = |part, f_x_per_mm, orientation_deg, terms| Quantity { part, f_x_per_mm, orientation_deg, terms };
        let mut quantities = vec![quantity("dc", 0.0, 0.0, dc)];
        for (i, c) in carriers.iter().enumerate() {
            let re = layout.re(i);
            quantities.push(quantity("re", c.f_x(), c.orientation_deg(), vec![(re, 0.5)]));
            quantities.push(quantity("im", c.f_x(), c.orientation_deg(), vec![(re + 1, 0.5)]));
        }
        Self { carriers, projected_images: ProjectedImages::NONE, layout, frames, quantities }
    }

    /// The layers of a pattern: a frame for each.
    ///
    /// Error: no layers, values outside [0, 1], another size than the projector's, another set of fringes than the params ask for.
    pub fn pattern(pattern: &Pattern, params: &Params, projector: &Projector, steady: bool) -> Result<Self, Error> {
        let stack = &pattern.0;
        let layers: Vec<&Layer> = stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value).collect();
        let infos: Vec<&LayerInfo> = layers.iter().map(|l| &l.info).collect();
        let (rows, columns) = (stack.rows(), stack.columns());
        fits(&infos, Some([rows as u64, columns as u64]), params, projector)?;
        for (i, layer) in layers.iter().enumerate() {
            // Also where a value is no number.
            if let Some(((row, column), v)) = layer.data.indexed_iter().find(|(_, v)| !(0.0..=1.0).contains(*v)) {
                return Err(Error::failed_with_hint(
                    format!(
                        "layer {i} of the pattern is {v} at row {row}, column {column}: a pattern must lie in [0, 1]"
                    ),
                    "scale it, and let the projector's power say how bright 1 is",
                ));
            }
        }
        let layout = Layout { carriers: 0, projected_images: layers.len(), steady };
        let projected_images =
            ProjectedImages::new(layers.len(), rows, columns, |layer, row, column| layers[layer].data[(row, column)]);
        let (frames, quantities) = of_layers(&infos, layout);
        Ok(Self { carriers: Vec::new(), projected_images, layout, frames, quantities })
    }

    /// M_DC and, where there is a fringe, the re and im whose error the error target is about: the highest f_x, its first orientation.
    pub fn watched(&self) -> (&Terms, Option<[&Terms; 2]>) {
        let dc = self.quantities.iter().find(|q| q.part == "dc").map_or(&self.frames[0].1, |q| &q.terms);
        let fringes = self.quantities.iter().enumerate().filter(|(_, q)| q.part == "re");
        // The first of the highest.
        let highest = fringes.rev().max_by(|a, b| a.1.f_x_per_mm.total_cmp(&b.1.f_x_per_mm));
        (dc, highest.map(|(i, q)| [&q.terms, &self.quantities[i + 1].terms]))
    }
}

/// Whether a pattern with these layers and, where they are known, rows and columns fits params and projector.
///
/// Error: no layers, another size than the projector's, another set of fringes than the params ask for.
pub fn fits(
    layers: &[&LayerInfo],
    pixels: Option<[u64; 2]>,
    params: &Params,
    projector: &Projector,
) -> Result<(), Error> {
    if layers.is_empty() {
        let way_out = "connect the output `pattern` of a stage that makes one";
        return Err(Error::failed_with_hint("the pattern has no layers: nothing would be projected", way_out));
    }
    if let (Some([c, r]), Some([rows, columns])) = (projector.pixels, pixels)
        && [r, c].map(u64::from) != [rows, columns]
    {
        return Err(Error::failed_with_hint(
            format!("the pattern is {columns} x {rows} pixels, the projector has {c} x {r}"),
            "make the pattern for this projector, or leave the projector's `pixels` out",
        ));
    }
    params.agree_with(layers)
}

/// A frame for each layer of a pattern, and the quantities behind them.
pub fn of_layers(layers: &[&LayerInfo], layout: Layout) -> (Vec<(LayerInfo, Terms)>, Vec<Quantity>) {
    let frame = |(i, layer): (usize, &&LayerInfo)| {
        let LayerInfo { f_x_per_mm, phase_rad, orientation_deg, .. } = **layer;
        let info = LayerInfo { f_x_per_mm, phase_rad, orientation_deg, ..LayerInfo::value("radiance", "") };
        let terms = [(layout.projected_image(i), 1.0)].into_iter().chain(layout.steady().map(|i| (i, 1.0)));
        (info, terms.collect())
    };
    let frames: Vec<(LayerInfo, Terms)> = layers.iter().enumerate().map(frame).collect();
    let quantities = fringes(&frames);
    (frames, quantities)
}

/// dc, re and im of every fringe with its phases, by the least-squares fit frame = dc + re cos(phase) - im sin(phase): for N even steps
/// the mean and the N-phase formulas. Frames whose phases fix no fit, or without f_x, have none.
fn fringes(frames: &[(LayerInfo, Terms)]) -> Vec<Quantity> {
    let key = |info: &LayerInfo| info.f_x_per_mm.map(|f| (f, info.orientation_deg.unwrap_or(0.0)));
    let mut keys: Vec<(f64, f64)> = Vec::new();
    for key in frames.iter().filter_map(|(info, _)| key(info)) {
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    let mut quantities = Vec::new();
    for (f, o) in keys {
        let members: Vec<&(LayerInfo, Terms)> = frames.iter().filter(|(info, _)| key(info) == Some((f, o))).collect();
        let combine = |weights: &[f64]| -> Terms {
            let parts = members.iter().zip(weights);
            parts.flat_map(|((_, terms), w)| terms.iter().map(move |(i, v)| (*i, w * v))).collect()
        };
        if f == 0.0 {
            let even = vec![1.0 / members.len() as f64; members.len()];
            quantities.push(Quantity { part: "dc", f_x_per_mm: f, orientation_deg: o, terms: combine(&even) });
            continue;
        }
        let phases: Option<Vec<f64>> = members.iter().map(|(info, _)| info.phase_rad).collect();
        let Some(weights) = phases.and_then(|phases| fit(&phases)) else { continue };
        for (part, weights) in ["dc", "re", "im"].into_iter().zip(&weights) {
            quantities.push(Quantity { part, f_x_per_mm: f, orientation_deg: o, terms: combine(weights) });
        }
    }
    quantities
}

/// Weights of frames with these phases that give dc, re, im; `None` where fewer than three differ.
fn fit(phases: &[f64]) -> Option<[Vec<f64>; 3]> {
    let basis: Vec<[f64; 3]> = phases
        .iter()
        .map(|phase| {
            let (sin, cos) = sin_cos_turns(phase / TAU);
            [1.0, cos, -sin]
        })
        .collect();
    let normal = |i: usize, j: usize| basis.iter().map(|b| b[i] * b[j]).sum::<f64>();
    let a: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| normal(i, j)));
    // The inverse by cofactors: three unknowns of one size.
    let cofactor = |i: usize, j: usize| {
        let (p, q, r, s) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        a[p][r] * a[q][s] - a[p][s] * a[q][r]
    };
    let determinant: f64 = (0..3).map(|j| a[0][j] * cofactor(0, j)).sum();
    let n = phases.len() as f64;
    // n^3 / 4 for even steps.
    (determinant > 1e-9 * n * n * n).then(|| {
        std::array::from_fn(|i| {
            basis.iter().map(|b| (0..3).map(|j| cofactor(j, i) * b[j]).sum::<f64>() / determinant).collect()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames made of dc, re, im give them back, for even, uneven and repeated phases; the N-phase formulas where they hold.
    #[test]
    fn the_fit_gives_back_what_made_the_frames() {
        let third = TAU / 3.0;
        for phases in [vec![0.0, third, 2.0 * third], vec![0.0, 1.0, 2.5, 2.5], vec![0.1, 0.2, 0.3]] {
            let weights = fit(&phases).unwrap();
            for (i, weights) in weights.iter().enumerate() {
                for j in 0..3 {
                    let value = |p: f64| [1.0, p.cos(), -p.sin()][j];
                    let found: f64 = weights.iter().zip(&phases).map(|(w, &p)| w * value(p)).sum();
                    // Phases within 0.2 rad of each other lose four digits.
                    assert!((found - f64::from(u8::from(i == j))).abs() < 1e-9, "{phases:?}: {i} {j} {found}");
                }
            }
        }
        let [dc, re, _] = fit(&[0.0, third, 2.0 * third]).unwrap();
        assert!(dc.iter().all(|w| (w - 1.0 / 3.0).abs() < 1e-15) && (re[0] - 2.0 / 3.0).abs() < 1e-15);
        assert!(fit(&[0.0, 1.0]).is_none() && fit(&[0.0, 1.0, 1.0 + TAU]).is_none());
    }
}
