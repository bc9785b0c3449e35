//! The double-sphere experiment as a user runs it.

use crate::space::Space;

/// A column of an exported table.
fn column(csv: &str, name: &str) -> Vec<f64> {
    let mut lines = csv.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().expect("a header");
    let index = header
        .split(',')
        .position(|cell| cell.split(['[', ' ', '_']).next() == Some(name) || cell == name)
        .unwrap_or_else(|| panic!("{name}: {header}"));
    lines.map(|line| line.split(',').nth(index).expect("a cell").parse().expect("a number")).collect()
}

/// Black, half and empty: the head comment of the check. 4.5 standard errors; the balance takes the light of the spheres as evenly diffuse, which
/// the hole of the entrance (0.25 % of it) breaks.
#[test]
fn integrating_spheres_keep_their_scale() {
    let file = format!("{}/pipelines/checks/integrating_spheres.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    space.turbid(&["run", &file]).ok();
    let csv = space.path().join("readings.csv");
    space.turbid(&["export", &file, "readings.readings", "--to", &csv.to_string_lossy()]).ok();
    let text = std::fs::read_to_string(&csv).expect("the export");
    println!("{text}");
    let (m_r, m_t, se) = (column(&text, "m_r"), column(&text, "m_t"), column(&text, "m_t_se"));
    assert!(m_r[0] == 0.0 && m_t[0] < 1e-20, "{text}");
    for (i, expected) in [(1, 0.5 * 0.99220), (2, 1.0)] {
        assert!((m_t[i] - expected).abs() < 4.5 * se[i] + 0.0025 * 0.01, "{expected}: {text}");
    }
}
