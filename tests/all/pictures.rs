//! Pictures of `outputs/latest`: what their files say, and when they are drawn anew.

use std::collections::BTreeMap;

use crate::space::{SMALL, Space, counts};

/// The text chunks of a picture of the pipeline `small`, and its bytes.
fn picture(space: &Space, path: &str) -> (BTreeMap<String, String>, Vec<u8>) {
    let bytes = std::fs::read(space.outputs().join("latest/small").join(path)).expect("the picture is there");
    let reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().expect("it is a PNG");
    let texts = reader.info().utf8_text.iter();
    (texts.map(|t| (t.keyword.clone(), t.get_text().expect("UTF-8"))).collect(), bytes)
}

/// The chunks name what the picture shows and the overrides that it depends on. A run that changes none of both leaves its bytes alone, in another
/// folder they are the same; an override of a later stage is none of its own.
#[test]
fn pictures_say_what_they_show() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let (plain, _) = picture(&space, "frames/frames.png");
    assert_eq!(
        (plain["Pipeline"].as_str(), plain["Stage"].as_str(), plain["Port"].as_str()),
        ("small", "frames", "frames")
    );
    assert_eq!((plain["Key"].len(), plain["Content"].len()), (64, 64));
    assert!(!plain.contains_key("Overrides"));

    let set = ["--set", "vars.samples=32", "--set", "stages.modulation.with.low_signal=1"];
    counts(&space, &set);
    let (frames, bytes) = picture(&space, "frames/frames.png");
    assert_eq!(frames["Overrides"], "--set vars.samples=32");
    assert_ne!(frames["Key"], plain["Key"]);
    let (modulation, _) = picture(&space, "modulation/modulation.png");
    assert_eq!(modulation["Overrides"], "--set vars.samples=32\n--set stages.modulation.with.low_signal=1");
    assert!(!picture(&space, "tissue/sketch.png").0.contains_key("Overrides"), "a scene has no samples");

    counts(&space, &["--set", "vars.samples=32"]);
    assert!(picture(&space, "frames/frames.png").1 == bytes, "nothing has changed for the frames");
    let other = Space::with(SMALL);
    counts(&other, &set);
    assert!(picture(&other, "frames/frames.png").1 == bytes, "the same artifact under the same caption");
}

/// Pink pixels of a picture.
fn marked(path: &std::path::Path) -> usize {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("the picture is there"));
    let mut reader = png::Decoder::new(file).read_info().expect("it is a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("it is small")];
    reader.next_frame(&mut pixels).expect("it is whole");
    pixels.chunks_exact(3).filter(|pixel| **pixel == [255, 0, 170]).count()
}

/// What lies beyond the table is marked in the maps, their standard errors and their errors, not where it is masked; the pitch of the camera's
/// pixels goes all the way to the files.
#[test]
fn the_end_of_a_table_does_not_look_like_data() {
    let file = format!("{}/pipelines/checks/table_end.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    let pictures = ["frames/truth.png", "maps/maps.png", "metrics/errors.png"];
    let found = |more: &[&str]| {
        space.turbid(&[&["run", file.as_str()], more].concat()).ok();
        pictures.map(|picture| marked(&space.outputs().join("latest/table_end").join(picture)))
    };
    // Half of the image: 128 pixels, 18 x 18 of the screen each, a third of them in stripes; along the seam the media mix. Two maps in both
    // pictures, with errors of their own in one and standard errors (9 x 9) in the other.
    let [truth, maps, errors] = found(&[]);
    let whole = 128 * 18 * 18 / 3;
    let near = |found: usize, expected: usize| found > expected * 3 / 4 && found < expected * 5 / 4;
    assert_eq!(truth, 0);
    assert!(near(maps, 2 * (whole + whole / 4)) && near(errors, 4 * whole), "{maps}, {errors} of {whole} a map");
    assert_eq!(found(&["--set", "vars.outside=mask"]), [0; 3], "masked pixels have grey stripes");
    space.turbid(&["export", &file, "metrics.errors", "--to", "errors.npz"]).ok();
    let bytes = std::fs::read(space.path().join("errors.npz")).expect("it was written");
    assert!(bytes.windows(16).any(|w| w == [4.0_f64; 2].map(f64::to_le_bytes).concat()), "a pixel is 4 x 4 mm");
}
