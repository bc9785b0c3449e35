//! What is said of frames before their files are read.

use std::io::Cursor;
use std::sync::Arc;

use serde_json::json;
use turbid_contract::payload::{Frames, Payload};
use turbid_contract::{Form, Known, StageRow};
use turbid_import::ImportFrames;

use crate::{COLUMNS, ROWS, grey8, import, tiff16};

fn exr() -> Arc<[u8]> {
    let mut bytes = Cursor::new(Vec::new());
    let image = exr::prelude::Image::from_channels(
        (COLUMNS, ROWS),
        exr::prelude::SpecificChannels::build().with_channel("Y").with_pixel_fn(|_| (0.25_f32,)),
    );
    exr::prelude::WritableImage::write(&image).to_buffered(&mut bytes).unwrap();
    bytes.into_inner().into()
}

/// One and several wavelengths, with and without noise, units, masks and conditions, of each kind of file; the size is that of the header.
#[test]
fn what_is_said_is_made() {
    let plain = json!({"pattern": "s{f_x}_{phase}_{wavelength}", "f_x": [0, 0.1], "wavelength_nm": [650, 532], "orientation_deg": 90});
    let mut noisy = plain.clone();
    let more = json!({"full_scale": 1e-5, "full_well": 1e4, "pixel_mm": 0.2, "conditions": {"half_space": true, "view_deg": 5}});
    noisy.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let listed = json!({"frames": [{"file": "a", "f_x": 0.1, "phase_deg": 30}, {"file": "b", "f_x": 0}]});
    // Some pixels are saturated, so that there is a mask.
    let files = [grey8(|i| if i < 3 { 255 } else { 100 }), tiff16(|_| 30_000), exr()];
    for params in [plain, noisy, listed] {
        for file in &files {
            let job = (StageRow::of::<ImportFrames>().prepare)(&params).unwrap();
            let uses = job.files();
            let named: Vec<(&str, Arc<[u8]>)> = uses.iter().map(|file_use| (&*file_use.at, file.clone())).collect();
            let files = named.iter().map(|(at, bytes)| ((*at).to_owned(), bytes.clone())).collect();
            let known = Known { files, ..Known::default() };
            let form = job.describe(&known).remove("frames").unwrap();
            assert!(form.pixels == Some([ROWS as u64, COLUMNS as u64]) && form.layers.is_some(), "{form:?}");
            let made = Frames(import(&params, &named).unwrap()).into_artifact();
            assert_eq!(form.broken_by(&Form::of(&made)), None, "{params}");
        }
    }
}

/// Files that are not there yet, or none of ours, leave the size open.
#[test]
fn sizes_are_not_guessed() {
    let params = json!({"frames": [{"file": "a", "f_x": 0}]});
    let job = (StageRow::of::<ImportFrames>().prepare)(&params).unwrap();
    let broken: Arc<[u8]> = grey8(|_| 1)[..20].into();
    for file in [None, Some(broken), Some(b"text".as_slice().into())] {
        let files = file.map(|bytes: Arc<[u8]>| ("frames.0.file".to_owned(), bytes)).into_iter().collect();
        let form = job.describe(&Known { files, ..Known::default() }).remove("frames").unwrap();
        assert!(form.pixels.is_none() && form.layers.is_some_and(|layers| layers.len() == 1));
    }
}
