//! The nodes of a glTF file: trees, each node of which is visited once.

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::document::{Document, Index, Node};

/// Calls `visit` with each node of the scene and its place in the world, a node before its children.
///
/// Error: nodes with several parents or below themselves, which the format forbids; a child that is not there; what `visit` says.
pub fn visit_nodes(
    document: &Document<'_>,
    visit: &mut dyn FnMut(usize, DMat4) -> Result<(), String>,
) -> Result<(), String> {
    let nodes = &document.nodes.0;
    let parents = parents(nodes)?;
    let (scenes, scene) = (&document.scenes.0, document.scene.0);
    let roots = match scenes.get(scene as usize) {
        Some(scene) if !scene.nodes.0.is_empty() => &scene.nodes.0,
        Some(_) => return Err(format!("its scene {scene} has no nodes")),
        None => return Err(format!("it has no scene {scene} (from 0): there are {}", scenes.len())),
    };
    let mut listed = vec![false; nodes.len()];
    let mut open = Vec::new();
    for root in roots {
        let named = || format!("scene {scene} names node {}", root.0);
        match parents.get(root.place()) {
            None => return Err(format!("{}, but there are only {} (from 0)", named(), nodes.len())),
            Some(Some(parent)) => {
                return Err(format!("{}, which is a child of node {parent}: it must have no parent", named()));
            }
            Some(None) if listed[root.place()] => return Err(format!("{} twice", named())),
            Some(None) => listed[root.place()] = true,
        }
        // Not by recursion: a chain may be as long as the file.
        open.push((root.0, DMat4::IDENTITY));
        while let Some((i, parent)) = open.pop() {
            let node = &nodes[i as usize];
            let world = parent * local(node);
            visit(i as usize, world)?;
            open.extend(node.children.0.iter().rev().map(|child| (child.0, world)));
        }
    }
    Ok(())
}

/// The parent of each node.
fn parents(nodes: &[Node]) -> Result<Vec<Option<u32>>, String> {
    let mut parents: Vec<Option<u32>> = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for &Index(child) in &node.children.0 {
            match parents.get_mut(child as usize) {
                None => {
                    return Err(format!(
                        "node {i} has the child {child}, but there are only {} nodes (from 0)",
                        nodes.len()
                    ));
                }
                Some(Some(parent)) if *parent as usize == i => {
                    return Err(format!("node {child} stands twice among the children of node {i}"));
                }
                Some(Some(parent)) => {
                    return Err(format!(
                        "node {child} is a child of node {parent} and of node {i}: it must have one parent; export a node of its own for each place"
                    ));
                }
                Some(none) => *none = Some(i as u32),
            }
        }
    }
    // With one parent each, what no root leads to goes in circles.
    let mut reached: Vec<bool> = parents.iter().map(Option::is_none).collect();
    let mut open: Vec<usize> = (0..nodes.len()).filter(|&i| reached[i]).collect();
    while let Some(i) = open.pop() {
        for child in &nodes[i].children.0 {
            reached[child.place()] = true;
            open.push(child.place());
        }
    }
    match reached.iter().position(|reached| !reached) {
        Some(i) => {
            let parent = parents[i].expect("a node without a parent was reached");
            Err(format!("node {i}, a child of node {parent}, is below itself: its ancestors go in a circle"))
        }
        None => Ok(parents),
    }
}

/// The transform of a node into its parent's frame.
fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let three = |given: &Option<Box<[f64; 3]>>, default| given.as_deref().map_or(default, |&v| DVec3::from(v));
    let rotation = node.rotation.as_deref().map_or(DQuat::IDENTITY, |&q| DQuat::from_array(q).normalize());
    DMat4::from_scale_rotation_translation(
        three(&node.scale, DVec3::ONE),
        rotation,
        three(&node.translation, DVec3::ZERO),
    )
}

/// Whether it turns triangles inside out.
pub fn mirrors(world: DMat4) -> bool {
    // Unit columns: products of small or large scales stay numbers.
    let unit = |column: DVec3| column / column.abs().max_element();
    let axes = DMat3::from_mat4(world);
    DMat3::from_cols(unit(axes.x_axis), unit(axes.y_axis), unit(axes.z_axis)).determinant() < 0.0
}
