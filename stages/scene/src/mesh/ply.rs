//! PLY, text and binary of both byte orders: the elements `vertex` (x, y, z) and `face` (a list of vertices), all others skipped.
//!
//! What the header promises is compared with the bytes behind it before a row is read.

mod body;
mod header;

use super::Soup;
use body::Body;
use header::{Element, header};

pub fn read(bytes: &[u8]) -> Result<Soup, String> {
    let (order, elements, rest) = header(bytes)?;
    let mut body = Body::new(order, rest)?;
    let mut soup = Soup::default();
    // The highest vertex that a face names, and the face: vertices may stand behind faces.
    let mut highest: Option<(u32, usize)> = None;
    for element in &elements {
        fits(element, &body)?;
        match element.name {
            "vertex" => vertices(element, &mut body, &mut soup)?,
            "face" => faces(element, &mut body, &mut soup, &mut highest)?,
            _ => {
                for row in 0..element.count {
                    element.properties.iter().try_for_each(|p| body.skip(p)).map_err(|e| at(element, row, &e))?;
                }
            }
        }
    }
    let there = soup.vertices.len();
    match highest {
        Some((vertex, face)) if vertex as usize >= there => {
            Err(format!("face {face} names the vertex {vertex}, but there are only {there} (from 0)"))
        }
        _ => Ok(soup),
    }
}

/// Whether the rest of the file can hold as many rows of an element as it says: a header of 100 bytes may say 4,000,000,000.
fn fits(element: &Element<'_>, body: &Body<'_>) -> Result<(), String> {
    let Element { name, count, properties } = element;
    if properties.is_empty() && *count > 0 {
        return Err(format!("element {name}: {count} rows without a property"));
    }
    let (least, left) = (properties.iter().map(|p| body.least(p)).sum::<usize>(), body.left());
    if count.checked_mul(least).is_none_or(|needed| needed > left) {
        return Err(format!(
            "element {name}: {count} rows of at least {least} bytes each, but {left} bytes are left: it is torn"
        ));
    }
    Ok(())
}

/// An error in a row of an element, counted from 0 as faces count vertices.
fn at(element: &Element<'_>, row: usize, what: &str) -> String {
    format!("{} {row}: {what}", element.name)
}

fn vertices(element: &Element<'_>, body: &mut Body<'_>, soup: &mut Soup) -> Result<(), String> {
    let axis = |name: &str| {
        let found = element.properties.iter().position(|p| p.name == name && p.length.is_none());
        found.ok_or_else(|| format!("its vertices have no `{name}`"))
    };
    let axes = [axis("x")?, axis("y")?, axis("z")?];
    soup.vertices.reserve_exact(element.count);
    for row in 0..element.count {
        let mut vertex = [0.0; 3];
        for (i, property) in element.properties.iter().enumerate() {
            let read = match axes.iter().position(|&axis| axis == i) {
                Some(axis) => body.number(property.of).map(|x| vertex[axis] = x),
                None => body.skip(property),
            };
            read.map_err(|e| at(element, row, &e))?;
        }
        if let Some(axis) = vertex.iter().position(|x| !x.is_finite()) {
            let name = ["x", "y", "z"][axis];
            return Err(at(element, row, &format!("{name} is {}, not a finite place", vertex[axis])));
        }
        soup.vertices.push(vertex);
    }
    Ok(())
}

fn faces(
    element: &Element<'_>,
    body: &mut Body<'_>,
    soup: &mut Soup,
    highest: &mut Option<(u32, usize)>,
) -> Result<(), String> {
    let mut corners = Vec::new();
    for row in 0..element.count {
        for property in &element.properties {
            let Some(length) = property.length.filter(|_| ["vertex_indices", "vertex_index"].contains(&property.name))
            else {
                body.skip(property).map_err(|e| at(element, row, &e))?;
                continue;
            };
            corners.clear();
            body.list(length, property.of, &mut corners).map_err(|e| at(element, row, &e))?;
            if corners.len() < 3 {
                return Err(at(
                    element,
                    row,
                    &format!("a face of {} vertices; it must have at least 3", corners.len()),
                ));
            }
            let most = corners.iter().copied().max().expect("at least three");
            if highest.is_none_or(|(known, _)| most > known) {
                *highest = Some((most, row));
            }
            soup.push_polygon(&corners);
        }
    }
    Ok(())
}
