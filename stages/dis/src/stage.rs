//! The stage `calibrate_dis`.

use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::{Value, json};
use turbid_contract::payload::Readings;
use turbid_contract::{
    Artifact, Cells, Ctx, Error, Form, Forms, Known, Pilot, Problems, Stage, StagePlan, Table, in_ports, out_ports,
};

use crate::assemble::{Experiment, assemble};
use crate::light::{Method, Setup, Target};
use crate::params::Params;
use crate::plate::Plate;
use crate::readings::{Loss, Measured, Normals};
use crate::sphere::{Port, Sphere};
use crate::stream::{Stream, of_medium};
use crate::tally::{Fate, Tally};

in_ports! {
    pub struct In {}
}

out_ports! {
    pub struct Out {
        /// M_R, M_T and lost light of each medium.
        readings: one Readings,
    }
}

/// `use: calibrate_dis`
pub struct CalibrateDis;

/// Photons of one tile; sums run in the order of the tiles.
const TILE: u64 = 8192;
/// Photons of each reading of a pilot: their events differ by a factor of 1.5 or so, which so many take to some percent.
const PILOT: u64 = 256;

impl Stage for CalibrateDis {
    const NAME: &'static str = "calibrate_dis";
    const VERSION: u32 = 3;
    const ABOUT: &'static str = "Simulates a double integrating sphere: M_R, M_T and lost light of a list of media";

    type Params = Params;
    type In = In<'static>;
    type Out = Out;

    fn draws(_: &Params) -> bool {
        true
    }

    fn check(params: &Params, _: &Known, problems: &mut Problems) {
        assemble(params, problems);
    }

    fn describe(params: &Params, _: &Known) -> Forms {
        let Some(experiment) = assemble(params, &mut Problems::default()) else { return Forms::new() };
        // Numbers of the media are not part of the form: a table without readings has its columns.
        let Readings(empty) = table(&experiment, &[]);
        let form = Form::of(&Artifact::Table(empty));
        Forms::from([("readings", Form { rows: Some(experiment.media.len() as u64), ..form })])
    }

    fn plan(params: &Params, _: &Known) -> StagePlan {
        let Some(experiment) = assemble(params, &mut Problems::default()) else { return StagePlan::default() };
        let method = match experiment.method {
            Method::Summed => "summed: bounces on the wall in closed form",
            Method::Traced => "traced: bounce by bounce, expected values at the detector",
            Method::Counted => "counted: bounce by bounce",
        };
        let mut left_out = Vec::new();
        if experiment.media.iter().all(|(_, plate)| plate.n == 1.0 && plate.slides == 1.0) {
            left_out.push("Fresnel reflection (n = 1)".to_owned());
        }
        if experiment.method == Method::Summed {
            left_out.push("bounces on the wall (summed)".to_owned());
        }
        // Measured on one core: 30 ns per scattering or bounce, about 2 optical depths per passage, two passages per photon.
        let [first, _] = &experiment.spheres;
        let bounces = match experiment.method {
            Method::Summed => 4.0,
            _ => 4.0 + 2.0 / (1.0 - first.reflectance * first.wall_fraction()),
        };
        let walks: f64 = experiment.media.iter().map(|(_, plate)| 10.0 + 4.0 * plate.mu_s * plate.thickness).sum();
        let events = walks + bounces * (experiment.media.len() + 3) as f64;
        StagePlan {
            method: Some(method.to_owned()),
            left_out,
            seconds: Some(3e-8 * events * experiment.photons as f64),
            bytes: Some(200 * experiment.media.len() as u64),
            ..StagePlan::default()
        }
    }

    fn pilot(params: &Params, _: &Known, ctx: Ctx<'_>) -> Option<Pilot> {
        let experiment = assemble(params, &mut Problems::default())?;
        let whole = experiment.all_photons();
        let few = Experiment { photons: experiment.photons.min(PILOT), ..experiment };
        let mut lab = Lab { experiment: &few, ctx, done: AtomicU64::new(0) };
        let media = few.media.iter().map(|(_, plate)| Target::Medium(*plate));
        for target in [Target::White(few.standard[0]), Target::Open, Target::Joined].into_iter().chain(media) {
            lab.read(target, 1).ok()?;
        }
        Some(Pilot { done: few.all_photons(), whole, unit: "photons", rest_s: 0.0 })
    }

    fn run(params: &Params, _: In<'_>, ctx: Ctx<'_>) -> Result<Out, Error> {
        let mut problems = Problems::default();
        let experiment = assemble(params, &mut problems);
        if let Some(problem) = problems.into_parts().0.into_iter().next() {
            return Err(Error::Invalid(problem));
        }
        let experiment = experiment.ok_or_else(|| Error::failed("no experiment without a problem"))?;
        let [reflectance, r_standard] = experiment.standard;
        let mut lab = Lab { experiment: &experiment, ctx, done: AtomicU64::new(0) };
        let normals = Normals {
            standard: lab.read(Target::White(reflectance), 1)?,
            open: lab.read(Target::Open, 2)?,
            straight: lab.read(Target::Joined, 3)?,
            // Without light there is nothing to read.
            blocked: Tally::default(),
            r_standard,
        };
        let mut measured = Vec::with_capacity(experiment.media.len());
        let mut leaked = 0.0f64;
        for (name, plate) in &experiment.media {
            let tally =
                lab.read(Target::Medium(*plate), of_medium(&[plate.mu_a, plate.mu_s, plate.phase.g(), plate.n]))?;
            leaked = leaked.max(tally.fate(Fate::Rim));
            let Some(found) = normals.measure(&tally) else {
                return Err(Error::failed_with_hint(
                    format!("no reading of {name}: standard or straight beam are no brighter than their background"),
                    "let the beam meet the sample port, and take a detector and walls that see light",
                ));
            };
            measured.push((name, plate, found));
        }
        ctx.measure("largest_share_lost_at_rim", leaked, "1");
        ctx.measure("photons", experiment.all_photons(), "1");
        Ok(Out { readings: table(&experiment, &measured) })
    }
}

struct Lab<'a> {
    experiment: &'a Experiment,
    ctx: Ctx<'a>,
    done: AtomicU64,
}

impl Lab<'_> {
    fn read(&mut self, target: Target, stream: u32) -> Result<Tally, Error> {
        let photons = self.experiment.photons;
        let setup: Setup = self.experiment.with(target);
        let total = self.experiment.all_photons();
        let tiles = usize::try_from(photons.div_ceil(TILE)).map_err(|_| Error::failed("too many samples"))?;
        let seed = self.ctx.seed();
        let tallies = self.ctx.map_tiles(tiles, |tile| {
            let first = tile as u64 * TILE;
            let mut tally = Tally::default();
            for photon in first..photons.min(first + TILE) {
                tally.add(&setup.photon(Stream::new(seed, stream, photon)));
            }
            let done = self.done.fetch_add(tally.photons, Ordering::Relaxed) + tally.photons;
            self.ctx.progress(done as f64, Some(total), "photons");
            tally
        })?;
        let mut sum = Tally::default();
        for tally in &tallies {
            sum.merge(tally);
        }
        Ok(sum)
    }
}

fn table(experiment: &Experiment, rows: &[(&String, &Plate, Measured)]) -> Readings {
    let mut table = Table::default();
    let names = rows.iter().map(|(name, ..)| (*name).clone()).collect();
    table.push("medium", "", Cells::Text(names));
    let number = |value: fn(&Measured) -> f64| Cells::F64(rows.iter().map(|(.., found)| value(found)).collect());
    let maybe = |value: &dyn Fn(&Measured) -> Option<f64>| {
        Cells::MaybeF64(rows.iter().map(|(.., found)| value(found)).collect())
    };
    table.push("m_r", "1", number(|m| m.m_r));
    table.push("m_r_se", "1", maybe(&|m| m.m_r_se));
    table.push("m_t", "1", number(|m| m.m_t));
    table.push("m_t_se", "1", maybe(&|m| m.m_t_se));
    table.push("m_rt_cov", "1", maybe(&|m| m.m_rt_cov));
    type Lost = (&'static str, fn(&Measured) -> Loss);
    let lost: [Lost; 4] = [
        ("lost_r", |m| m.lost_r),
        ("lost_t", |m| m.lost_t),
        ("lost_r_diffuse", |m| m.lost_r_diffuse),
        ("lost_t_diffuse", |m| m.lost_t_diffuse),
    ];
    for (name, value) in lost {
        table.push(name, "1", maybe(&|m| value(m).map(|(share, _)| share)));
        table.push(format!("{name}_se"), "1", maybe(&|m| value(m).and_then(|(_, se)| se)));
    }
    let of_plate = |value: fn(&Plate) -> f64| Cells::F64(rows.iter().map(|(_, plate, _)| value(plate)).collect());
    table.push("mu_a", "mm^-1", of_plate(|p| p.mu_a));
    table.push("mu_s_prime", "mm^-1", of_plate(|p| p.mu_s * (1.0 - p.phase.g())));
    table.push("g", "1", of_plate(|p| p.phase.g()));
    table.push("n", "1", of_plate(|p| p.n));
    attributes(&mut table, experiment);
    Readings(table)
}

fn attributes(table: &mut Table, experiment: &Experiment) {
    let [first, second] = &experiment.spheres;
    let share = |sphere: &Sphere, port| sphere.port_fraction(port);
    let plate = experiment.media.first().map(|(_, plate)| plate);
    let mut set = |name: &str, value: Value| table.attributes.insert(name.to_owned(), value);
    set("thickness", json!(plate.map(|p| p.thickness)));
    set("slides", json!(plate.map(|p| p.slides).filter(|&n| n > 1.0)));
    set("r_standard", json!(experiment.standard[1]));
    set(
        "spheres",
        json!({
            "diameter": 2.0 * first.radius,
            "wall_reflectance": first.reflectance,
            "sample": share(first, Port::Sample),
            "entrance": share(first, Port::Entrance),
            "detector": share(first, Port::Detector),
            "exit": share(second, Port::Exit),
            "neck": first.plane - Sphere::rim(first.radius, first.sample.outline),
            "bounces": experiment.bounces,
            "baffle": first.baffle.is_some(),
            "sees_sample": first.sees_sample && first.baffle.is_none(),
        }),
    );
}
