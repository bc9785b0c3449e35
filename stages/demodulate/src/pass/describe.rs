//! From planes of numbers to layers that say what they are.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::MaskReason;
use turbid_contract::sharing::Sharing;
use turbid_contract::{ImageStack, LayerInfo, LayerKind};

use crate::layers::{Group, OfChannel};
use crate::pass::{Pass, Tally};
use crate::unknown;

pub type Described = (LayerInfo, Array2<f32>);

impl Pass<'_> {
    /// Gives the planes their descriptions and sorts them into the two stacks. `frames`: as they were given, and which of their channels this is.
    pub fn describe(
        &self,
        planes: Vec<Array2<f32>>,
        tally: &Tally,
        frames: (&ImageStack, usize),
        values: &mut Group<Described>,
        phases: &mut Group<Described>,
    ) {
        let fringes = &self.channel.fringes;
        let known = self.blocks.is_some();
        let OfChannel { values: infos, covariances, mask, phases: phase_infos, .. } =
            OfChannel::new(self.channel, values.values.len());
        let phase_infos = if self.wants_phase { phase_infos } else { Vec::new() };
        let uncertain = self.uncertain(&planes, tally);
        let flags: Vec<Option<Vec<bool>>> =
            self.unknown.iter().map(|of_frames| either(of_frames.as_deref(), uncertain.as_deref())).collect();
        let flagged = |info: &LayerInfo, k: usize, mask: &Array2<f32>| {
            flags[k].as_ref().filter(|_| known).and_then(|flags| unknown::layer(info, flags, mask))
        };
        // The direction of a phasor that noise has turned over is nobody's phase.
        let turned = |i: usize| uncertain.as_ref().is_some_and(|flags| flags[i]);
        let last = planes.last().expect("the mask is the last plane");
        values.unknown.extend(infos.iter().enumerate().filter_map(|(q, info)| flagged(info, q / 2, last)));
        if self.wants_phase {
            let mut data = last.clone();
            if uncertain.is_some() {
                let weak = data.iter_mut().enumerate().filter(|(i, _)| turned(*i));
                weak.for_each(|(_, mask)| *mask = MaskReason::LowSignal.code());
            }
            let fringed = (0..fringes.len()).filter(|&k| fringes[k].f_x_per_mm > 0.0);
            let own = phase_infos.iter().zip(fringed).filter_map(|(info, k)| flagged(info, k, &data));
            phases.unknown.extend(own);
            phases.masks.push((mask.clone(), data));
        }
        let of_means = self.mean_errors(&planes, frames);
        let mut planes = planes.into_iter();
        let mut next = || planes.next().expect("as many planes as plane_count says");
        for (info, &mean_se) in infos.iter().zip(&of_means) {
            values.values.push((LayerInfo { mean_se, ..info.clone() }, next()));
        }
        if known {
            infos.iter().for_each(|info| values.errors.push((info.standard_error(), next())));
        }
        if known {
            covariances.into_iter().for_each(|info| values.covariances.push((info, next())));
        }
        let phase_plane = |mut plane: Array2<f32>| {
            if uncertain.is_some() {
                plane.iter_mut().enumerate().filter(|(i, _)| turned(*i)).for_each(|(_, value)| *value = 0.0);
            }
            plane
        };
        for (info, &mean_se) in phase_infos.iter().zip(&of_means[infos.len()..]) {
            phases.values.push((LayerInfo { mean_se, ..info.clone() }, phase_plane(next())));
        }
        if known {
            phase_infos.iter().for_each(|info| phases.errors.push((info.standard_error(), phase_plane(next()))));
        }
        values.masks.push((mask, next()));
    }

    /// The standard error of the mean of each quantity, then of each phase, where it is known.
    fn mean_errors(&self, planes: &[Array2<f32>], (frames, channel): (&ImageStack, usize)) -> Vec<Option<f64>> {
        let (count, phases) = (self.quantity_count(), self.phase_count());
        if self.blocks.is_none() {
            return vec![None; count + phases];
        }
        let plane = |k: usize| planes[k].as_slice().expect("planes are row-major");
        let (m_dc, m_dc_se, mask) = (plane(0), plane(count), plane(planes.len() - 1));
        let good = |i: usize| mask[i] == 0.0;
        let sharing = match frames.covariance_of_m_dc(channel) {
            // What pixels share of M_DC they share of M_AC, as parts of their variances.
            Some(covariance) => {
                // Masked pixels hold 0 by now.
                let sum = m_dc.iter().map(|&m| f64::from(m)).sum::<f64>();
                let squares =
                    m_dc.iter().zip(m_dc_se).map(|pair| [pair.0, pair.1].map(|&x| f64::from(x) * f64::from(x)));
                Sharing::of_shared(covariance * sum * sum, squares)
            }
            None => {
                let shot = frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
                shot.map(|l| frames.sharing(&l.info)).fold(Sharing::even(frames.common_sharing()), Sharing::or)
            }
        };
        // What frames do not know of a pixel they may still know of their mean.
        let known = |k: &usize| self.unknown[*k].is_none() || self.mean_known[*k];
        let fringes = &self.channel.fringes;
        let fringed = (0..fringes.len()).filter(|&k| self.wants_phase && fringes[k].f_x_per_mm > 0.0);
        // Standard errors of phases follow covariances and the phases themselves.
        let of_phases = 2 * count + self.pairs.len() + phases;
        let places = (0..count).map(|q| (q / 2, count + q)).chain(fringed.zip(of_phases..));
        places.map(|(k, place)| Some(k).filter(known).and_then(|_| sharing.mean_se(plane(place), good))).collect()
    }

    /// The good pixels of which noise has left no signal, but whose neighbours have one; `None` where there are none.
    fn uncertain(&self, planes: &[Array2<f32>], tally: &Tally) -> Option<Vec<bool>> {
        if tally.uncertain == 0 {
            return None;
        }
        let mask = planes.last().expect("the mask is the last plane");
        let mut flags = vec![false; mask.len()];
        for plane in &planes[..self.quantity_count()] {
            let pixels = flags.iter_mut().zip(plane.iter().zip(mask));
            pixels.for_each(|(flag, (&value, &mask))| *flag |= mask == 0.0 && value <= 0.0);
        }
        flags.contains(&true).then_some(flags)
    }
}

/// Where either is set; `None` where neither is there.
fn either(a: Option<&[bool]>, b: Option<&[bool]>) -> Option<Vec<bool>> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.iter().zip(b).map(|(a, b)| *a || *b).collect()),
        (one, other) => one.or(other).map(<[bool]>::to_vec),
    }
}
