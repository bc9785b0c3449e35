//! Slips of units: each raises one warning, which names the value, the usual range and the unit that may be meant; what is odd on purpose
//! raises none.

use serde_json::{Value, json};

use super::{carcinoma, check, with};

/// Where the value is put, what stands there, where the one warning stands, what it says, and the way out.
fn slips() -> Vec<(Value, &'static str, &'static str, &'static str)> {
    let flat = |mut params: Value| {
        params["objects"].as_object_mut().unwrap().remove("polyp");
        params
    };
    let slab = |thickness: f64| flat(with("/objects/tissue/slab/thickness", json!(thickness)));
    let near = |who: &str| flat(with(&format!("/{who}/position"), json!([0, 0, 0.5])));
    vec![
        (with("/media/scc/mu_a", json!(1.2)), "media.scc.mu_a", "mu_a = 1.2 mm^-1 is unusual", "`1.2 cm^-1`"),
        (with("/media/scc/mu_a", json!(120)), "media.scc.mu_a", "0.0003 to 1 mm^-1", "`120 m^-1`"),
        (with("/media/scc/mu_a", json!(1.2e-4)), "media.scc.mu_a", "tissue and phantoms have", "`0.00012 um^-1`"),
        (with("/media/scc/mu_s_prime", json!(10)), "media.scc.mu_s_prime", "0.1 to 8 mm^-1", "`10 cm^-1`"),
        (with("/media/scc/mu_s_prime", json!(640)), "media.scc.mu_s_prime", "= 640 mm^-1", "`640 m^-1`"),
        (with("/media/scc/mu_s_prime", json!(6.4e-4)), "media.scc.mu_s_prime", "= 0.00064 mm^-1", "`0.00064 um^-1`"),
        (with("/media/healthy/A_rho", json!(0.025)), "media.healthy.A_rho", "0.3 to 1000 m^-1", "`0.025 mm^-1`"),
        (with("/media/healthy/S_rho", json!(4.236)), "media.healthy.S_rho", "= 4.236 m^-1", "`4.236 mm^-1`"),
        (slab(0.03), "objects.tissue", "0.03 mm thick, and nothing is thicker, in a field of 64 mm", "`0.03 m`"),
        (slab(0.1), "objects.tissue", "0.1 mm thick", "`0.1 m`"),
        (near("camera"), "camera.position", "very near for a field of 64 mm", "`0.5 m`"),
        (with("/camera/field", json!([0.064, 0.064])), "camera.field", "the camera sees 0.064 mm", "`0.064 m`"),
        (near("projector"), "projector.position", "a field of 128 mm", "`0.5 m`"),
        (with("/projector/power", json!(5000)), "projector.power", "0.0001 to 200 W", "`5000 mW`"),
        (with("/wavelength_nm", json!([0.65])), "wavelength_nm.0", "200 to 2500 nm", "`0.65 um`"),
        (
            with("/objects/polyp/spheroid", json!({"diameters": [0.04, 0.04, 0.08], "center": [0, 0, 0]})),
            "objects.polyp",
            "less than a pixel of the camera",
            "`0.08 m`",
        ),
    ]
}

#[test]
fn each_slip_of_a_unit_raises_one_warning() {
    for (params, path, says, way_out) in slips() {
        let (mistakes, warnings) = check(&params);
        assert!(mistakes.is_empty() && warnings.len() == 1, "{path}: {mistakes:?} {warnings:?}");
        let warning = &warnings[0];
        let hint = warning.hint.as_deref().unwrap_or_default();
        assert!(warning.path == path && warning.message.contains(says) && hint.contains(way_out), "{warning}");
    }
}

/// The paper's grid of densities, clear and black media, thin layers on tissue, narrow views of few pixels.
#[test]
fn what_is_odd_on_purpose_is_not_doubted() {
    let medium = |medium: Value| with("/media/healthy", medium);
    let mut right = vec![
        medium(json!({"mu_a": 1e5, "mu_s": 0, "g": 0, "n": 1.0})),
        medium(json!({"mu_a": 1.0, "mu_s": 1e-6, "g": 0.8, "n": 1.0})),
        medium(json!({"A_rho": 0, "S_rho": 1, "g": 0.8, "n": 1.0})),
        medium(json!({"mu_a": 0.01, "mu_s": 100, "g": 0.9, "n": 1.0})),
        with("/objects/film", json!({"slab": {"thickness": 0.05, "top": 60}, "medium": "healthy"})),
        with(
            "/camera",
            json!({"position": [0, 0, 500], "look_at": [0, 0, 0], "field": [0.02, 0.02], "pixels": [4, 4]}),
        ),
    ];
    for a_rho in [1, 25, 100, 500] {
        for s_rho in [1000, 5000, 20_000, 50_000] {
            right.push(medium(json!({"A_rho": a_rho, "S_rho": s_rho, "g": 0.8, "n": 1.0})));
        }
    }
    for params in right {
        let (mistakes, warnings) = check(&params);
        assert!(mistakes.is_empty() && warnings.is_empty(), "{params}: {mistakes:?} {warnings:?}");
    }
    let (mistakes, _) = check(&carcinoma());
    assert!(mistakes.is_empty());
}

#[test]
fn per_cent_without_their_sign_have_a_way_out() {
    let (mistakes, _) = check(&with("/media/scc/g", json!(80)));
    assert_eq!(
        mistakes[0].to_string(),
        "media.scc.g: g = 80 must lie in (-1, 1) (if per cent are meant, write `80 %`)"
    );
}
