//! What modulation and phase will hold, by the form of the frames.

use turbid_contract::{Form, Forms, Known, LayerInfo};

use crate::layers::{Group, OfChannel, OfShot, mask, of_speckle};
use crate::params::{Method, Params};
use crate::set::channels;
use crate::snapshot::shots;
use crate::speckled::by_wavelength;

/// Layers of modulation and phase.
type Both = [Group<LayerInfo>; 2];

pub fn describe(params: &Params, known: &Known) -> Forms {
    let Some(frames) = known.form("frames") else { return Forms::new() };
    let layers = match params.method {
        Method::PhaseShift => of_phases(frames, known.is_connected("covariance")),
        Method::SingleShot => of_shots(frames),
        Method::Speckle => under_speckle(params, frames),
    };
    // Without the layers of the frames, or where these do not say whether they have standard errors, those of the results are open.
    let open = Form { pixels: frames.pixels, attributes: frames.attributes.clone(), ..Form::default() };
    let Some([modulation, phase]) = layers else {
        return Forms::from([("modulation", open.clone()), ("phase", open)]);
    };
    let mut modulation = modulation.into_form(open.clone());
    modulation.carry_conditions(frames);
    let mut forms = Forms::from([("modulation", modulation)]);
    if params.method != Method::Speckle {
        forms.insert("phase", phase.into_form(open));
    }
    forms
}

fn of_phases(frames: &Form, covariance: bool) -> Option<Both> {
    let layers: Vec<&LayerInfo> = frames.layers.as_ref()?.iter().collect();
    let [mut modulation, mut phase] = Both::default();
    for channel in channels(&layers).ok()? {
        let own = OfChannel::new(&channel, modulation.values.len());
        let mut known = true;
        for &frame in channel.fringes.iter().flat_map(|fringe| &fringe.frames).filter(|_| !covariance) {
            known &= frames.has_error_of(layers[frame])?;
        }
        if known {
            // Where noise has left no signal of a pixel, its errors are unknown, too.
            modulation.add_errors(&own.values, true);
            modulation.errors.extend(own.ambient.iter().map(LayerInfo::standard_error));
            phase.add_errors(&own.phases, true);
            modulation.covariances.extend(own.covariances);
        }
        modulation.values.extend(own.values);
        modulation.values.extend(own.ambient);
        phase.values.extend(own.phases);
        modulation.masks.push(own.mask.clone());
        phase.masks.push(own.mask);
    }
    Some([modulation, phase])
}

fn of_shots(frames: &Form) -> Option<Both> {
    let layers: Vec<&LayerInfo> = frames.layers.as_ref()?.iter().collect();
    let [mut modulation, mut phase] = Both::default();
    let mut seen = Vec::new();
    for shot in shots(&layers).ok()?.into_iter().map(|k| layers[k]) {
        let own = OfShot::new(shot, !seen.contains(&shot.wavelength_nm), modulation.values.len());
        seen.push(shot.wavelength_nm);
        let values = [own.means, vec![own.m_ac]].concat();
        if frames.has_error_of(shot)? {
            let flags = frames.may_flag(shot);
            modulation.add_errors(&values, flags);
            phase.add_errors(std::slice::from_ref(&own.phase), flags);
            modulation.covariances.extend(own.covariances.into_iter().map(|(info, _)| info));
        }
        modulation.values.extend(values);
        phase.values.push(own.phase);
        if !modulation.masks.contains(&own.mask) {
            modulation.masks.push(own.mask.clone());
        }
        phase.masks.push(own.mask);
    }
    Some([modulation, phase])
}

fn under_speckle(params: &Params, frames: &Form) -> Option<Both> {
    let layers: Vec<&LayerInfo> = frames.layers.as_ref()?.iter().collect();
    let mut modulation = Group::default();
    for (wavelength_nm, own) in by_wavelength(&layers).ok()? {
        let values = of_speckle(layers[own[0]], &params.f_x).concat();
        modulation.add_errors(&values, own.iter().any(|&k| frames.may_flag(layers[k])));
        modulation.values.extend(values);
        modulation.masks.push(mask(wavelength_nm));
    }
    Some([modulation, Group::default()])
}
