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
    assert!(!picture(&space, "tissue/preview.png").0.contains_key("Overrides"), "a scene has no samples");

    counts(&space, &["--set", "vars.samples=32"]);
    assert!(picture(&space, "frames/frames.png").1 == bytes, "nothing has changed for the frames");
    let other = Space::with(SMALL);
    counts(&other, &set);
    assert!(picture(&other, "frames/frames.png").1 == bytes, "the same artifact under the same caption");
}
