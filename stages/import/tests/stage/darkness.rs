//! What a camera reads without light: a number, or frames for each wavelength and exposure.

use serde_json::json;
use turbid_contract::LayerKind;

use crate::{check, import, tiff16};

/// A black level is a dark frame of that number; dark frames belong to the frames of their wavelength and exposure, and those of the same are averaged.
#[test]
fn darkness_is_a_number_or_a_frame_for_each_exposure() {
    let light = |i: usize| 1000 + 10 * i as u16;
    let file = |at: &'static str, value: &dyn Fn(usize) -> u16| (at, tiff16(value));
    let frames = json!([{"file": "a.tif", "f_x": 0, "wavelength_nm": 660, "exposure_ms": 4},
        {"file": "b.tif", "f_x": 0, "wavelength_nm": 850, "exposure_ms": 20}]);
    let shots = [file("frames.0.file", &|i| 40 + 4 * light(i)), file("frames.1.file", &|i| 70 + 20 * light(i))];
    let darks = json!([{"file": "d4.tif", "wavelength_nm": 660}, {"file": "d20.tif", "exposure_ms": 20}, {"file": "e20.tif", "exposure_ms": 20}]);
    let of_darks = [file("darks.0.file", &|_| 40), file("darks.1.file", &|_| 60), file("darks.2.file", &|_| 80)];
    let files: Vec<_> = shots.iter().chain(&of_darks).cloned().collect();
    let params = json!({"frames": frames, "darks": darks});
    assert_eq!(check(&params, &files), "");
    let stack = import(&params, &files).unwrap();
    for layer in stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value) {
        assert_eq!(layer.info.unit, "ms^-1");
        for (i, &value) in layer.data.iter().enumerate() {
            let expected = f32::from(light(i)) / 65535.0;
            assert!((value / expected - 1.0).abs() < 1e-6, "{value} for {expected}");
        }
    }
    let one = json!({"frames": [{"file": "a.tif", "f_x": 0}], "black_level": 40});
    let dark = json!({"frames": [{"file": "a.tif", "f_x": 0}], "dark": "d.tif"});
    let by_number = import(&one, &[shots[0].clone()]).unwrap();
    let by_frame = import(&dark, &[shots[0].clone(), file("dark", &|_| 40)]).unwrap();
    assert_eq!(by_number, by_frame);

    for (params, said) in [
        (
            json!({"frames": frames, "darks": [{"file": "d.tif", "exposure_ms": 4}]}),
            "none of them is for `b.tif` (wavelength 850 nm, exposure 20 ms)",
        ),
        (
            json!({"frames": frames, "darks": [{"file": "d.tif"}, {"file": "e.tif", "exposure_ms": 5}]}),
            "`e.tif` is for no frame",
        ),
        (json!({"frames": frames, "darks": [{"file": "d.tif", "page": 0}]}), "pages are counted from 1"),
        (json!({"frames": frames, "dark": "d.tif", "black_level": 3}), "said by `dark` and by `black_level`"),
        (json!({"frames": frames, "black_level": -1}), "black_level = -1"),
        (
            json!({"frames": [{"file": "a.tif", "f_x": 0, "exposure_ms": 4}, {"file": "b.tif", "f_x": 0}]}),
            "`b.tif` says no exposure_ms",
        ),
        (json!({"frames": [{"file": "a.tif", "f_x": 0, "exposure_ms": 0}]}), "exposure_ms = 0"),
        (
            json!({"frames": [{"file": "a.tif", "f_x": 0}], "exposure_ms": [4]}),
            "exposure_ms is of the files of `pattern`",
        ),
        (json!({"pattern": "{f_x}.tif", "f_x": [0], "exposure_ms": [4, 5]}), "2 exposures for 0 wavelengths"),
    ] {
        let problems = check(&params, &[]);
        assert!(problems.contains(said), "{params}: {problems}");
    }
}
