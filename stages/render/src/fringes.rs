//! Which responses the image of a surface is fitted by, *reduced* ones, and how those of paths are made of them.

use std::ops::Range;

use glam::DVec2;
use turbid_optics::elementary::sin_cos_turns;

use crate::fringe_shape::{FringeShape, LEAST_CONTRAST};
use crate::light::{Carrier, Light};
use crate::projected::{Projected, Quantity, Terms};
use crate::projected_images::ProjectedImages;
use crate::response::ONE;

/// Images that are off the sinusoids of their phases by more than this are not fitted: values are f32.
const MOST_OFF: f64 = 1e-5;

/// Reduced responses are, in this order: that to the pattern 1; of images the mean of each fringe; re and im of each fringe.
#[derive(Clone, Debug, PartialEq)]
pub struct Fringes {
    /// Of each fringe of images, by its own frames; empty for carriers, whose mean is half the response to 1.
    means: Vec<Terms>,
    /// How many have re and im.
    pairs: usize,
    /// re and im of each fringe of images.
    parts: Vec<[Terms; 2]>,
    /// What each image is made of.
    images: Vec<Image>,
}

/// mean + cos(phase) re - sin(phase) im.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Image {
    mean: usize,
    /// Of the fringe, and the cosine and sine of the phase.
    part: Option<(usize, f64, f64)>,
}

impl Fringes {
    pub fn carriers(count: usize) -> Self {
        Self { means: Vec::new(), pairs: count, parts: Vec::new(), images: Vec::new() }
    }

    /// Those of what is shown; why there are none where images are no sinusoids whose phases are known.
    pub fn of(projected: &Projected) -> Result<Self, String> {
        if projected.projected_images.layers() == 0 {
            return Ok(Self::carriers(projected.carriers.len()));
        }
        let mut fringes = Self::carriers(0);
        let mut quantities = projected.quantities.iter().peekable();
        let mut keys = Vec::new();
        while let Some(dc) = quantities.next() {
            let part = (dc.f_x_per_mm > 0.0).then(|| [quantities.next(), quantities.next()]);
            let part = part.map(|part| part.map(|q: Option<&Quantity>| q.map_or_else(Terms::new, |q| q.terms.clone())));
            keys.push(((dc.f_x_per_mm, dc.orientation_deg), part.is_some().then_some(fringes.parts.len())));
            fringes.means.push(dc.terms.clone());
            fringes.parts.extend(part);
        }
        fringes.pairs = fringes.parts.len();
        for (number, (info, _)) in projected.frames.iter().enumerate() {
            let key = info.f_x_per_mm.map(|f| (f, info.orientation_deg.unwrap_or(0.0)));
            let Some((mean, &(_, part))) = keys.iter().enumerate().find(|(_, known)| Some(known.0) == key) else {
                return Err(format!("image {number} of the pattern belongs to no set of phases"));
            };
            let (sin, cos) = sin_cos_turns(info.phase_rad.unwrap_or(0.0) / std::f64::consts::TAU);
            fringes.images.push(Image { mean, part: part.map(|part| (part, cos, sin)) });
        }
        if let Some((number, off)) = fringes.most_off(projected).filter(|most| most.1 > MOST_OFF) {
            return Err(format!("image {number} of the pattern is off a sinusoid of its phase by up to {off:.2}"));
        }
        for (fringe, &((f, o), _)) in keys.iter().filter(|(_, part)| part.is_some()).enumerate() {
            if let Some(reason) = fringes.shape(fringe, projected).refusal() {
                return Err(format!("the images of f_x = {f} mm^-1 at {o} deg are no sinusoids: {reason}"));
            }
        }
        Ok(fringes)
    }

    /// What three values cannot show by themselves, which are always a sinusoid's: the shape of a fringe from pixel to pixel.
    fn shape(&self, fringe: usize, projected: &Projected) -> FringeShape {
        let images = &projected.projected_images;
        let of_fringe = || self.images.iter().filter(|image| image.part.is_some_and(|part| part.0 == fringe));
        let mean = of_fringe().next().map_or(&[][..], |image| &self.means[image.mean]);
        FringeShape::of(images.size(), of_fringe().count(), |row, column| {
            let values = images.texel(row, column);
            let of = |terms: &[(usize, f64)]| 2.0 * sum_over(terms, projected.layout.projected_image(0), values);
            let [re, im] = self.parts[fringe].each_ref().map(|terms| of(terms));
            (DVec2::new(re, im), of(mean))
        })
    }

    /// The image that is off the sinusoid of its phases the most, and by how much.
    fn most_off(&self, projected: &Projected) -> Option<(usize, f64)> {
        let images = &projected.projected_images;
        let [rows, columns] = images.size();
        let mut most = vec![0.0_f64; self.images.len()];
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let values = images.texel(row, column);
            let of = |terms: &Terms| sum_over(terms, projected.layout.projected_image(0), values);
            let means: Vec<f64> = self.means.iter().map(of).collect();
            let parts: Vec<[f64; 2]> = self.parts.iter().map(|parts| parts.each_ref().map(of)).collect();
            for (number, image) in self.images.iter().enumerate() {
                let modulated = image.part.map_or(0.0, |(part, cos, sin)| cos * parts[part][0] - sin * parts[part][1]);
                most[number] = most[number].max((f64::from(values[number]) - means[image.mean] - modulated).abs());
            }
        }
        most.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// How many reduced responses there are.
    pub fn count(&self) -> usize {
        self.singles() + 2 * self.pairs
    }

    /// How many of them come before the pairs of re and im.
    pub fn singles(&self) -> usize {
        1 + self.means.len()
    }

    /// How many fringes have a phase.
    pub fn phases(&self) -> usize {
        self.pairs
    }

    /// (sin, cos) of every fringe's phase where a point of the pattern's plane is lit, times its contrast; `None` where there is hardly any.
    pub fn at(&self, projected: &Projected, light: &Light, on_plane: glam::DVec3) -> Option<Vec<(f64, f64)>> {
        if self.images.is_empty() {
            return Some(projected.carriers.iter().map(|c: &Carrier| c.at(on_plane)).collect());
        }
        let images: &ProjectedImages = &projected.projected_images;
        let (x, y) = light.view.position_of(on_plane);
        let around = images.around(x, y);
        let values: Vec<f32> = (0..images.layers()).map(|layer| images.value(layer, &around) as f32).collect();
        let of = |terms: &Terms| 2.0 * sum_over(terms, projected.layout.projected_image(0), &values);
        let phase = |[re, im]: &[Terms; 2]| {
            let (sin, cos) = (of(im), of(re));
            (sin * sin + cos * cos >= LEAST_CONTRAST * LEAST_CONTRAST).then_some((sin, cos))
        };
        self.parts.iter().map(phase).collect()
    }

    /// Place of re of a fringe among the reduced responses; im follows.
    fn re(&self, fringe: usize) -> usize {
        self.singles() + 2 * fringe
    }

    /// Response i under light of `gain` and these phases as a sum of weight x reduced response.
    pub fn in_reduced(&self, i: usize, gain: f64, phases: &[(f64, f64)]) -> Terms {
        if i == ONE {
            return vec![(ONE, gain)];
        }
        if self.images.is_empty() {
            let fringe = (i - 1) / 2;
            let (re, (sin, cos)) = (self.re(fringe), phases[fringe]);
            let (of_re, of_im) = if i == re { (cos, -sin) } else { (sin, cos) };
            return vec![(re, gain * of_re), (re + 1, gain * of_im)];
        }
        let image = self.images[i - 1];
        let mut terms = vec![(1 + image.mean, gain)];
        if let Some((fringe, c, s)) = image.part {
            let (re, (sin, cos)) = (self.re(fringe), phases[fringe]);
            terms.extend([(re, gain * (c * cos - s * sin)), (re + 1, -gain * (c * sin + s * cos))]);
        }
        terms
    }

    /// Reduced response a as a sum of weight x response: undoes [`in_reduced`](Self::in_reduced).
    pub fn reduced(&self, a: usize, gain: f64, phases: &[(f64, f64)]) -> Terms {
        if a == ONE {
            return vec![(ONE, 1.0 / gain)];
        }
        if a <= self.means.len() {
            return self.means[a - 1].iter().map(|&(i, w)| (i, w / gain)).collect();
        }
        let fringe = (a - self.re(0)) / 2;
        let (re, (sin, cos)) = (self.re(fringe), phases[fringe]);
        let (of_re, of_im) = if a == re { (cos, sin) } else { (-sin, cos) };
        if self.images.is_empty() {
            return vec![(re, of_re / gain), (re + 1, of_im / gain)];
        }
        let scale = 1.0 / (gain * (sin * sin + cos * cos));
        let [re, im] = &self.parts[fringe];
        let of = |terms: &Terms, w: f64| terms.iter().map(|&(i, v)| (i, scale * w * v)).collect::<Vec<_>>();
        [of(re, of_re), of(im, of_im)].concat()
    }
}

/// Of the values of images whose responses begin at `first`.
fn sum_over(terms: &[(usize, f64)], first: usize, values: &[f32]) -> f64 {
    terms.iter().map(|&(i, w)| w * f64::from(values[i - first])).sum()
}

/// `singles` responses alone, and pairs of the rest.
pub fn groups(singles: usize, count: usize) -> impl Iterator<Item = Range<usize>> + Clone {
    (0..singles).map(|a| a..a + 1).chain((singles..count).step_by(2).map(|a| a..a + 2))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use turbid_contract::LayerInfo;

    use super::*;
    use crate::projected::of_layers;
    use crate::response::Layout;

    const SIDE: usize = 32;

    /// Images by (f_x, phase), whose values are those of `value`(f_x, phase, column).
    fn shown(layers: &[(f64, f64)], value: impl Fn(f64, f64, usize) -> f64) -> Projected {
        let layout = Layout { carriers: 0, projected_images: layers.len(), steady: false };
        let info = |&(f, phase): &(f64, f64)| LayerInfo {
            phase_rad: Some(phase),
            ..LayerInfo::value("pattern", "1").with_f_x(f)
        };
        let infos: Vec<LayerInfo> = layers.iter().map(info).collect();
        let (frames, quantities) = of_layers(&infos.iter().collect::<Vec<_>>(), layout);
        let images = ProjectedImages::new(layers.len(), 1, SIDE, |layer, _, column| {
            value(layers[layer].0, layers[layer].1, column) as f32
        });
        Projected { carriers: Vec::new(), projected_images: images, layout, frames, quantities }
    }

    /// A fringe of 4 columns' period and half contrast that darkens from column to column.
    fn fringe(f: f64, phase: f64, column: usize) -> f64 {
        let modulation = if f > 0.0 { 0.5 * (TAU * column as f64 / 4.0 + phase).cos() } else { 0.0 };
        (1.0 - 0.01 * column as f64) * 0.5 * (1.0 + modulation)
    }

    const THREE: [(f64, f64); 3] = [(0.1, 0.0), (0.1, TAU / 3.0), (0.1, 2.0 * TAU / 3.0)];

    /// What images of three and of four phases and one without a fringe bring is found again from its reduced responses, and these from it; so for carriers. 1e-12 is rounding.
    #[test]
    fn reduced_responses_are_the_responses() {
        let four = [(0.2, 0.0), (0.2, 0.25 * TAU), (0.2, 0.5 * TAU), (0.2, 0.75 * TAU)];
        let images = shown(&[&THREE[..], &four, &[(0.0, 0.0)]].concat(), fringe);
        let images = Fringes::of(&images).expect("they are fringes");
        assert_eq!((images.count(), images.singles(), images.phases()), (1 + 3 + 4, 4, 2));
        for fringes in [images, Fringes::carriers(2)] {
            let phases = [(0.3, -0.4), (-0.96, 0.28)];
            let phases = if fringes.images.is_empty() { [(0.6, -0.8), phases[1]] } else { phases };
            let (gain, given): (f64, Vec<f64>) = (0.7, (0..fringes.count()).map(|a| 1.0 + (a * a) as f64).collect());
            let sum = |terms: Terms, values: &[f64]| terms.iter().map(|&(i, w)| w * values[i]).sum::<f64>();
            let width = if fringes.images.is_empty() { 5 } else { 1 + fringes.images.len() };
            let responses: Vec<f64> = (0..width).map(|i| sum(fringes.in_reduced(i, gain, &phases), &given)).collect();
            for (a, value) in given.iter().enumerate() {
                let found = sum(fringes.reduced(a, gain, &phases), &responses);
                assert!((found - value).abs() < 1e-12 * (1.0 + value.abs()) * 100.0, "{a}: {found} {value}");
            }
        }
    }

    /// Where a column's centre is lit the fringe has the phase and the contrast of that column; where it has none, nothing is said.
    #[test]
    fn phases_are_those_of_the_images() {
        let view = turbid_optics::view::View::new(
            glam::DVec3::new(0.0, 0.0, 10.0),
            glam::DVec3::ZERO,
            glam::DVec3::Y,
            DVec2::new(SIDE as f64, 1.0),
        );
        let light = Light::new(view.expect("not along y"), 1.0, true);
        let at = |column: usize| glam::DVec3::new(column as f64 + 0.5 - 0.5 * SIDE as f64, 0.0, 0.0);
        let projected = shown(&THREE, |f, phase, column| if column < 20 { fringe(f, phase, column) } else { 0.25 });
        let fringes = Fringes::of(&projected).expect("three phases always are a fringe");
        for column in 0..20 {
            let [(sin, cos)] = fringes.at(&projected, &light, at(column)).expect("contrast")[..] else {
                panic!("one fringe")
            };
            let contrast = 0.5 * (1.0 - 0.01 * column as f64);
            let (s, c) = (TAU * column as f64 / 4.0).sin_cos();
            assert!((sin - contrast * s).abs() < 1e-6 && (cos - contrast * c).abs() < 1e-6, "{column}: {sin} {cos}");
        }
        assert!(fringes.at(&projected, &light, at(25)).is_none());
    }

    /// Six square waves are no sinusoid, one layer without a frequency has no phase.
    #[test]
    fn other_images_are_refused() {
        let square =
            |_: f64, phase: f64, column: usize| f64::from(u8::from((TAU * column as f64 / 16.0 + phase).sin() > 0.0));
        let six: Vec<(f64, f64)> = (0..6).map(|k| (0.2, TAU * f64::from(k) / 6.0)).collect();
        let refused = Fringes::of(&shown(&six, square)).expect_err("harmonics");
        assert!(refused.contains("off a sinusoid"), "{refused}");
        let refused = Fringes::of(&shown(&THREE, square)).expect_err("three values are always a sinusoid's");
        assert!(refused.contains("no sinusoids: "), "{refused}");
        let refused = Fringes::of(&shown(&THREE[..2], fringe)).expect_err("two phases");
        assert!(refused.contains("no set of phases"), "{refused}");
    }
}
