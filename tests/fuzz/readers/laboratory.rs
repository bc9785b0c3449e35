//! Readings of laboratories: `.rxt` and CSV of `calibrate_iad`.

use serde_json::json;

use super::stage::FileOf;
use super::{Reader, Seen, nothing};
use crate::mutate::Form;

fn rxt() -> FileOf {
    // Eight points and no lost light: what is read matters here, not how well it is solved.
    FileOf { stage: "calibrate_iad", at: "file", params: json!({"file": "x.rxt", "N": 8, "lost_light": "ignore"}) }
}

fn csv() -> FileOf {
    let params =
        json!({"file": "x.csv", "N": 8, "lost_light": "ignore", "n": 1.4, "g": 0.8, "thickness": 1, "spheres": "none"});
    FileOf { stage: "calibrate_iad", at: "file", params }
}

pub fn readers() -> Vec<Reader> {
    vec![
        Reader {
            name: "rxt",
            form: Form::Text,
            share: 3,
            claims: nothing,
            seeds: || {
                let phantom = include_bytes!("../../../pipelines/data/phantom.rxt");
                let port = include_bytes!("../../../pipelines/checks/data/port.rxt");
                vec![phantom.to_vec(), port.to_vec(), LETTERS.as_bytes().to_vec()]
            },
            read: |input| Ok(Seen::as_large(rxt().check(input), input)),
            law: |input| rxt().run(input),
        },
        Reader {
            name: "readings",
            form: Form::Text,
            share: 3,
            claims: nothing,
            seeds: || [SHORT, ERRORS, KNOWN].map(|text| text.as_bytes().to_vec()).to_vec(),
            read: |input| Ok(Seen::as_large(csv().check(input), input)),
            law: |input| csv().run(input),
        },
    ]
}

/// A file whose columns letters name.
const LETTERS: &str = "IAD1\n1.36 1.50\n1.0 1.0 3.0\n0.985\n2\n203.2 25.4 12.7 5.0 0.97\n203.2 25.4 0 5.0 0.97\nL r t u g\n\
                       500 0.40677 0.42977 0.001099 0.8\n700 0.42617 0.61380 0.004785 0.9\n";

const SHORT: &str = "medium,m_r [%],m_t\nmilk,30,0.2\nink,5,0.01\n";
const ERRORS: &str = "# of today\nwavelength [um],m_r,m_r_se,m_t,m_t_se,m_rt_cov,m_u,m_u_se\n0.5,0.3,0.001,0.2,0.002,1e-7,0.01,0.001\n\
                      0.6,0.31,0.001,0.21,0.002,0,0.02,0.001\n";
const KNOWN: &str = "medium,m_r,m_t,mu_a [cm^-1],n\na,0.3,0.2,0.1,1.4\nb,0.31,0.21,0.2,1.33\n";
