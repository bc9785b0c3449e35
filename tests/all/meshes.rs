//! Mesh files: what each broken one is told, and what is in the key.

use turbid::plan::Plan;
use turbid::registry::Registry;
use turbid::resolve::Resolver;
use turbid::spec;
use turbid::store::Store;
use turbid_optics::solid::mesh::Built;

use crate::space::{Space, counts};

const PIPELINE: &str = "\
pipeline: mesh
stages:
  lump:
    use: scene
    with:
      media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1}}
      objects:
        lump: {mesh: {file: lump.obj}, medium: m}
      camera: {position: [0, 0, 50], look_at: [0, 0, 0], field: [8, 8], pixels: [4, 4]}
      projector: {position: [0, 9, 50], look_at: [0, 0, 0], field: [16, 16], power: 5}
  frames:
    use: render
    in: {scene: lump}
    with: {f_x: [0], samples: 8}
";

/// A tetrahedron of 2 mm.
const LUMP: &str = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// What is replaced, by what, the message, the way out.
const WRONG: &[(&str, &str, &str, &str)] = &[
    ("v 0 0 0\n", "v 0 0 zero\n", "`lump.obj`: line 1: `zero` is no number (z)", ""),
    ("f 2 3 4\n", "f 2 3 5\n", "`lump.obj`: line 8: a face names the vertex 5, but there are only 4", ""),
    (
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "",
        "`lump.obj`: the mesh has no triangle",
        "export a surface of triangles",
    ),
    (
        "f 2 3 4\n",
        "",
        "`lump.obj`: 3 edges with one triangle only: the surface has holes; the first is at (1.0000, 1.0000, 0.0000) mm",
        "fill the holes, or merge vertices that should be one",
    ),
    (
        "f 2 3 4\n",
        "f 2 4 3\n",
        "`lump.obj`: 3 edges whose two triangles have normals to different sides; the first is at (1.0000, 1.0000, 0.0000) mm",
        "recalculate normals so that all point outwards",
    ),
    (
        "f 2 3 4\n",
        "f 2 3 4\nf 2 3 4\n",
        "`lump.obj`: 3 edges with more than two triangles: the surface is not that of a solid; the first is at (1.0000, 1.0000, 0.0000) mm",
        "take out inner faces and doubles",
    ),
    (
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n",
        "`lump.obj`: the normals of the part at (0.0000, 0.0000, 0.0000) mm point inwards (its volume is -1.333333 mm^3)",
        "flip its normals",
    ),
    (
        "f 2 3 4\n",
        "f 2 3 4\nv 0.2 0.2 -1\nv 0.4 0.2 -1\nv 0.2 0.4 -1\nv 0.2 0.2 1\nf 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\n",
        "`lump.obj`: 3 pairs of triangles run through each other, the first at (0.3000, 0.2000, 0.0000) mm",
        "unite the parts (boolean union) in a mesh editor, or make them objects of their own with different priorities",
    ),
];

#[test]
fn each_broken_mesh_gets_its_message() {
    let space = Space::with(PIPELINE);
    space.write("lump.obj", LUMP);
    space.turbid(&["check", "p.yaml"]).ok();
    let mut failures = String::new();
    for (from, to, message, way_out) in WRONG {
        assert!(LUMP.contains(from), "{from}");
        space.write("lump.obj", &LUMP.replacen(from, to, 1));
        let shown = space.turbid(&["check", "p.yaml"]).fails(2);
        let place = format!("p.yaml:8:29: error: stages.lump.with.objects.lump.mesh.file: {message}\n");
        let hint = if way_out.is_empty() { String::new() } else { format!(" = help: {way_out}\n") };
        if !shown.contains(&place) || !shown.contains(&hint) || shown.matches(" error: ").count() != 1 {
            failures += &format!("{from} -> {to}\nexpected: {place}{hint}{shown}\n");
        }
    }
    assert_eq!(failures, "");
    std::fs::remove_file(space.path().join("lump.obj")).expect("it is there");
    assert!(
        space.turbid(&["check", "p.yaml"]).fails(2).contains("8:29: error: stages.lump.with.objects.lump.mesh.file: ")
    );
}

/// The content is in the key of the scene; what of it does not change the scene stops there.
#[test]
fn a_mesh_file_is_part_of_the_key() {
    let space = Space::with(PIPELINE);
    space.write("lump.obj", LUMP);
    assert_eq!(counts(&space, &[]), (0, 2));
    assert_eq!(counts(&space, &[]), (2, 0));
    space.write("lump.obj", &format!("# the same\n{LUMP}"));
    assert_eq!(counts(&space, &[]), (1, 1), "a comment makes the scene anew, not the frames");
    space.write("lump.obj", &LUMP.replace("v 0 0 2", "v 0 0 2.5"));
    assert_eq!(counts(&space, &[]), (0, 2));
}

/// Scene and renderer share the tree over a mesh's triangles, whatever either does with it, and a look before the run does without the cells that paths need.
#[test]
fn a_tree_is_built_once_for_scene_and_renderer() {
    let space = Space::with(PIPELINE);
    space.write("lump.obj", LUMP);
    let (spec, report) = spec::read(&space.path().join("p.yaml"), &[]);
    let plan = Plan::build(spec.expect("it is right"), report, &Registry::builtin(), &[]).expect("it fits");
    let store = Store::open(&space.path().join("outputs")).expect("a new store");
    let before = Built::here();
    let survey = Resolver::new(&plan, &store).survey(&[]);
    let built = Built { trees: Built::here().trees - before.trees, cells: Built::here().cells - before.cells };
    assert!(survey.problems.iter().all(|problem| problem.severity == spec::Severity::Warning), "{:?}", survey.problems);
    assert_eq!(survey.plans.values().count(), 2, "both stages are looked at");
    assert_eq!(built, Built { trees: 1, cells: 0 });
}
