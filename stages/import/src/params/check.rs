//! Mistakes in the params of `import_frames` that can be seen without the files.

use turbid_contract::{Length, PerLength, Problems};

use super::{FrameParams, MOST_FILES, ONE_PICTURE, Params, Shot};
use crate::names::{self, Place};

impl Params {
    /// Reports every mistake that can be seen without the files.
    pub fn check(&self, problems: &mut Problems) {
        match (&self.pattern, self.frames.is_empty()) {
            (None, true) => problems.push_with_hint(
                "",
                "no files are named",
                "give `pattern` with f_x and phases, or `frames` as a list of {file, f_x, phase_deg}",
            ),
            (Some(_), false) => {
                problems.push("frames", "files come from `pattern` and from `frames`; give one of them")
            }
            (Some(pattern), true) => self.check_pattern(pattern, problems),
            (None, false) => {}
        }
        if self.count() > MOST_FILES {
            let at = if self.frames.is_empty() { "phases" } else { "frames" };
            let message = format!("{} files are named, more than {MOST_FILES}", self.count());
            problems.push_with_hint(at, message, "give each set of frames a stage of its own, or an axis");
        }
        let mut require = |holds: bool, name: &str, value: f64, unit: &str, rule: &str| {
            problems.require(holds, name, value, unit, rule);
        };
        require((0.1..=10.0).contains(&self.gamma), "gamma", self.gamma, "", "lie in [0.1, 10]");
        let saturation = self.saturation;
        require(saturation > 0.0 && saturation <= 1.0, "saturation", saturation, "", "lie in (0, 1]");
        if let Some([_, _, width, height]) = self.crop {
            require(width > 0 && height > 0, "crop", f64::from(width.min(height)), "px", "be a width and a height > 0");
        }
        require((1..=64).contains(&self.bin), "bin", f64::from(self.bin), "px", "lie in [1, 64]");
        let steps = f64::from(self.phases_at_0);
        require(self.phases_at_0 == 1 || self.phases_at_0 >= 3, "phases_at_0", steps, "", "be 1, or 3 and more");
        if let Some(bits) = self.bits {
            require((1..=32).contains(&bits), "bits", f64::from(bits), "bits", "lie in [1, 32]");
        }
        if let Some(v) = self.full_scale {
            require(v > 0.0 && v.is_finite(), "full_scale", v, "W mm^-2 sr^-1", "be a finite number > 0");
        }
        if let Some(v) = self.full_well {
            require(v >= 1.0 && v.is_finite(), "full_well", v, "electrons", "be a finite number >= 1");
        }
        if let Some(v) = self.black_level {
            require(v.is_finite() && v >= 0.0, "black_level", v, "", "be a finite number >= 0");
        }
        for (k, &ms) in self.exposure_ms.iter().enumerate() {
            require(ms > 0.0 && ms.is_finite(), &format!("exposure_ms.{k}"), ms, "ms", "be a finite number > 0");
        }
        let read_noise = self.read_noise;
        require(read_noise >= 0.0 && read_noise.is_finite(), "read_noise", read_noise, "electrons", "be >= 0");
        if let Some(Length(v)) = self.pixel_mm {
            require(v > 0.0 && v.is_finite(), "pixel_mm", v, "mm", "be a finite number > 0");
        }
        if read_noise > 0.0 && self.full_well.is_none() {
            problems.push(
                "read_noise",
                "read_noise is in electrons, and full_well, which says how many fill the range, is not given",
            );
        }
        for (k, frame) in self.frames.iter().enumerate() {
            let (f_x, exposure) = (frame.f_x.0, frame.exposure);
            problems.require(f_x >= 0.0 && f_x.is_finite(), format!("frames.{k}.f_x"), f_x, "mm^-1", "be >= 0");
            if frame.page == Some(0) {
                problems.push(format!("frames.{k}.page"), "pages are counted from 1");
            }
            let at = format!("frames.{k}.exposure");
            problems.require((-30.0..=30.0).contains(&exposure), at, exposure, "stops", "lie in [-30, 30]");
        }
        self.check_exposures(problems);
        self.check_darks(problems);
        if let Some(conditions) = &self.conditions {
            conditions.check(problems);
        }
        if self.rig.as_ref().is_some_and(|name| name.trim().is_empty()) {
            problems.push_with_hint("rig", "the name of the rig is empty", "name the bench, or leave `rig` out");
        }
        self.check_sets(problems);
    }

    /// Reports what cannot stand beside a connected `transfer`.
    pub fn check_transfer(&self, problems: &mut Problems) {
        for (name, given) in [("full_well", self.full_well.is_some()), ("read_noise", self.read_noise > 0.0)] {
            if given {
                problems.push(name, format!("the camera's noise comes from the port `transfer`: leave {name} out"));
            }
        }
        if self.gamma != 1.0 {
            problems.push("gamma", "the noise of the port `transfer` is that of a linear camera: leave gamma out");
        }
    }

    /// Every frame has an exposure time, or none has.
    fn check_exposures(&self, problems: &mut Problems) {
        let times = self.exposure_ms.len();
        if times > 1 && times != self.wavelength_nm.len() {
            let message = format!("{times} exposures for {} wavelengths", self.wavelength_nm.len());
            problems.push_with_hint("exposure_ms", message, "give one for all, or one for each of `wavelength_nm`");
        }
        if times > 0 && self.pattern.is_none() {
            let hint = "in a list of frames each says its own `exposure_ms`";
            problems.push_with_hint(
                "exposure_ms",
                "exposure_ms is of the files of `pattern`, which is not given",
                hint,
            );
        }
        let said = self.frames.iter().position(|f| f.exposure_ms.is_some());
        for (k, frame) in self.frames.iter().enumerate() {
            let at = || format!("frames.{k}.exposure_ms");
            match (frame.exposure_ms, said) {
                (Some(ms), _) => problems.require(ms > 0.0 && ms.is_finite(), at(), ms, "ms", "be a finite number > 0"),
                (None, Some(other)) => {
                    problems.push(at(), format!("`{}` says no exposure_ms, and frames.{other} does", frame.file));
                    return;
                }
                (None, None) => return,
            }
        }
    }

    /// One way to say what the camera reads without light, and for every frame.
    fn check_darks(&self, problems: &mut Problems) {
        let ways = [
            ("dark", self.dark.is_some()),
            ("darks", !self.darks.is_empty()),
            ("black_level", self.black_level.is_some()),
        ];
        let given: Vec<&str> = ways.iter().filter(|way| way.1).map(|way| way.0).collect();
        if let [first, second, ..] = given[..] {
            problems.push(
                second,
                format!("what the camera reads without light is said by `{first}` and by `{second}`; give one of them"),
            );
        }
        for (k, dark) in self.darks.iter().enumerate().filter(|(_, dark)| dark.page == Some(0)) {
            problems.push(format!("darks.{k}.page"), format!("`{}`: pages are counted from 1", dark.file));
        }
        if self.darks.is_empty() {
            return;
        }
        let shots = self.shots();
        if let Some(shot) = shots.iter().find(|shot| !self.darks.iter().any(|dark| dark.is_for(shot))) {
            let of = |name: &str, value: Option<f64>, unit: &str| value.map(|v| format!("{name} {v} {unit}"));
            let what: Vec<String> =
                [of("wavelength", shot.wavelength_nm, "nm"), of("exposure", shot.exposure_ms, "ms")]
                    .into_iter()
                    .flatten()
                    .collect();
            let what = if what.is_empty() { "no wavelength or exposure".to_owned() } else { what.join(", ") };
            problems.push_with_hint(
                "darks",
                format!("none of them is for `{}` ({what})", shot.file),
                "a dark frame that names neither wavelength nor exposure is for all",
            );
        }
        for (k, dark) in self.darks.iter().enumerate() {
            if !shots.is_empty() && !shots.iter().any(|shot| dark.is_for(shot)) {
                problems.push(
                    format!("darks.{k}"),
                    format!("`{}` is for no frame: none has its wavelength and exposure", dark.file),
                );
            }
        }
    }

    /// Warns of what can be read but hardly be meant: a picture that counts twice.
    pub fn check_meaning(&self, problems: &mut Problems) {
        for (k, frame) in self.frames.iter().enumerate() {
            let same = |other: &FrameParams| {
                other.file == frame.file && other.page == frame.page && other.variable == frame.variable
            };
            if let Some(first) = self.frames[..k].iter().position(same) {
                problems.warn(
                    format!("frames.{k}.file"),
                    format!(
                        "`{}` stands at frames.{first} too: one picture counts as two frames with noise of their own; name each picture of a file by `page`",
                        frame.file
                    ),
                );
            }
        }
    }

    fn check_pattern(&self, pattern: &str, problems: &mut Problems) {
        if self.f_x.is_empty() {
            problems.push_with_hint("pattern", "a pattern needs f_x", "f_x: [0, 0.1], for example");
        }
        for (k, &PerLength(f_x)) in self.f_x.iter().enumerate() {
            problems.require(f_x >= 0.0 && f_x.is_finite(), format!("f_x.{k}"), f_x, "mm^-1", "be >= 0");
            if self.f_x[..k].iter().any(|other| other.0 == f_x) {
                problems.push(
                    format!("f_x.{k}"),
                    format!("f_x = {f_x} mm^-1 stands twice: its files would count as twice as many frames"),
                );
            }
        }
        for (k, nm) in self.wavelength_nm.iter().enumerate() {
            if self.wavelength_nm[..k].contains(nm) {
                problems.push(
                    format!("wavelength_nm.{k}"),
                    format!("wavelength_nm = {nm} nm stands twice: its files would count as twice as many frames"),
                );
            }
        }
        let first =
            Place { f_x: 0.0, f_x_index: 0, phase: 0, phases: 1, wavelength_nm: Some(0.0), wavelength_index: 0, n: 0 };
        if let Err(what) = names::fill(pattern, &first) {
            problems.push_with_hint("pattern", format!("`{pattern}`: {what}"), names::KNOWN);
        }
        let several = self.f_x.iter().any(|f_x| self.phases_of(*f_x) > 1);
        let name = pattern.to_lowercase();
        if several && !names::has_phase(pattern) && ONE_PICTURE.iter().any(|kind| name.ends_with(kind)) {
            problems.push("pattern", format!("`{pattern}` names one file for all: {{phase}} is missing"));
        }
        if self.wavelength_nm.is_empty() && names::has(pattern, &["wavelength", "wavelength_nm"]) {
            problems.push_with_hint(
                "pattern",
                "the pattern names a wavelength, and `wavelength_nm` lists none",
                "wavelength_nm: [660, 850], for example",
            );
        }
        for (what, names, needed) in [
            ("{f_x}", &["f_x", "f_x_index", "n"][..], self.f_x.len() > 1),
            ("{wavelength}", &["wavelength", "wavelength_nm", "wavelength_index", "n"], self.wavelength_nm.len() > 1),
        ] {
            if needed && !names::has(pattern, names) {
                problems.push("pattern", format!("`{pattern}` names one file for all: {what} is missing"));
            }
        }
    }

    /// A sinusoid takes three phases, a single shot one; two are neither.
    fn check_sets(&self, problems: &mut Problems) {
        let shots = self.shots();
        for (k, shot) in shots.iter().enumerate().filter(|(_, s)| s.f_x > 0.0) {
            let same = |s: &&Shot| {
                s.f_x == shot.f_x && s.orientation_deg == shot.orientation_deg && s.wavelength_nm == shot.wavelength_nm
            };
            let set: Vec<&Shot> = shots.iter().filter(same).collect();
            if set.len() == 2 && std::ptr::eq(set[0], &raw const shots[k]) {
                let at = if self.pattern.is_some() { "phases".to_owned() } else { shot.at.clone() };
                let message = format!("two frames at f_x = {} mm^-1 fix no sinusoid", shot.f_x);
                problems.push_with_hint(at, message, "three phases or more, or one for demodulate's single_shot");
            }
        }
    }
}
