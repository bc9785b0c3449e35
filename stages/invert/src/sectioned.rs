//! A table ready for use: one solver for each section, blended where a pixel belongs to two.

use std::sync::{Arc, Mutex, PoisonError};

use turbid_contract::payload::{Lut, MaskReason, Sections, Shares};
use turbid_contract::{Ctx, Error, Layer};

use crate::forward::Forward;
use crate::inverse::InverseTable;
use crate::least_squares::LeastSquares;
use crate::linear::Triangles;
use crate::lut::{self, Errors};
use crate::nearest::Nodes;
use crate::pair::{Inside, Inverter};
use crate::params::{Method, Outside, Params};
use crate::pass::Solved;
use crate::surface::Surface;

/// What the solvers of one section read.
pub struct Prepared {
    forward: Forward,
    surfaces: Vec<Surface>,
    nodes: Option<Nodes>,
    /// None for `least_squares`.
    pub table: Option<InverseTable>,
    errors: Option<Errors>,
}

impl Prepared {
    /// `noise`: whether the reflectance has any. Error: see [`lut::read`].
    pub fn new(lut: &Lut, section: usize, f_x: &[f64], params: &Params, noise: bool) -> Result<Self, Error> {
        let Params { method, outside, .. } = *params;
        let (grids, errors) = lut::read(lut, section, f_x)?;
        let forward = Forward::new([grids[0].clone(), grids[grids.len() - 1].clone()]);
        let many = method == Method::LeastSquares;
        let needs_nodes = many || method == Method::Nearest || outside == Outside::Nearest;
        let nodes = needs_nodes.then(|| Nodes::new(&forward));
        let bends = noise && method == Method::Table;
        // Other methods begin from what the table says, and do not end with it.
        let table =
            |forward| if method == Method::Table { InverseTable::new(forward) } else { InverseTable::coarse(forward) };
        let table = (!many).then(|| table(&forward));
        let table = if bends { table.map(|table| table.with_bends(&forward)) } else { table };
        let surfaces = if many { grids.into_iter().map(Surface::new).collect() } else { Vec::new() };
        Ok(Self { forward, surfaces, nodes, table, errors })
    }

    pub fn solver(&self, method: Method, outside: Outside) -> Solver<'_> {
        let nodes = self.nodes.as_ref();
        let r_0_range = r_0_range(&self.forward);
        let errors = self.errors.as_ref();
        let Some(table) = &self.table else {
            let nodes = nodes.expect("least squares begins at nodes");
            return Solver::Many(LeastSquares { surfaces: &self.surfaces, nodes, r_0_range, errors });
        };
        let inside = match (method, nodes) {
            (Method::Nearest, Some(nodes)) => Inside::Nearest(nodes),
            (Method::Linear, _) => Inside::Linear(Triangles::new(&self.forward)),
            (Method::Bicubic, _) => Inside::Bicubic,
            _ => Inside::Table,
        };
        let nodes_outside = nodes.filter(|_| outside == Outside::Nearest);
        Solver::Pair(Inverter { inside, table, nodes_outside, r_0_range, forward: &self.forward, errors })
    }
}

/// Smallest and largest R_0 at the nodes.
fn r_0_range(forward: &Forward) -> [f64; 2] {
    let [a, s] = forward.nodes();
    let all = a.iter().flat_map(|&a| s.iter().map(move |&s| [a, s])).map(|p| libm::exp(forward.at(p).ln_r[0]));
    all.fold([f64::INFINITY, 0.0], |[low, high], r| [low.min(r), high.max(r)])
}

/// The two kinds of inversion.
pub enum Solver<'a> {
    Pair(Inverter<'a>),
    Many(LeastSquares<'a>),
}

impl Solver<'_> {
    /// `r`: one reflectance per f_x; `c_r(i, j)`: covariance of R_i and R_j relative to both, where it is known.
    pub fn solve(&self, r: &[f64], c_r: Option<&dyn Fn(usize, usize) -> f64>) -> Result<Solved, MaskReason> {
        match self {
            Self::Pair(inverter) => {
                let matrix = c_r.map(|c| {
                    let between = c(0, 1);
                    [[c(0, 0), between], [between, c(1, 1)]]
                });
                inverter.solve([r[0], r[1]], matrix)
            }
            Self::Many(fit) => fit.solve(r, c_r),
        }
    }
}

impl Solver<'_> {
    /// Whether p is that of a node, and no smooth function of the reflectance.
    pub fn reads_nodes(&self) -> bool {
        matches!(self, Self::Pair(inverter) if matches!(inverter.inside, Inside::Nearest(_)))
    }
}

/// Which section's solver holds for which pixel.
pub struct Places {
    shares: Option<Vec<Option<Shares>>>,
    /// Pixels that belong to no section, with the reason.
    pub mask: Option<Vec<f32>>,
}

impl Places {
    /// `size`: rows and columns of the reflectance. Errors: a sectioned table without sections, sections without a sectioned table, or of another number or size.
    pub fn new(
        sections: Option<&Sections>,
        tables: usize,
        size: (usize, usize),
        sectioned: bool,
    ) -> Result<Self, Error> {
        let Some(sections) = sections else {
            if sectioned {
                return Err(Error::failed_with_hint(
                    format!("the table has {tables} sections, and which pixel belongs to which is not known"),
                    "connect the port `sections` to the section_tube that build_lut used",
                ));
            }
            return Ok(Self { shares: None, mask: None });
        };
        let count = sections.list()?.len();
        if !sectioned || count != tables {
            let has = if sectioned { tables.to_string() } else { "no".to_owned() };
            let what = format!("there are {count} sections, and the table has {has} sections");
            return Err(Error::failed_with_hint(what, "give build_lut and invert the same sections"));
        }
        if (sections.0.rows(), sections.0.columns()) != size {
            return Err(Error::failed("the sections are of another camera: their image has another size"));
        }
        let mask = sections.0.find("mask", None).map(|l| Layer::pixels(l).into_owned());
        Ok(Self { shares: Some(sections.shares()?), mask })
    }

    pub fn sectioned(&self) -> bool {
        self.shares.is_some()
    }

    /// What the solvers of the pixel's sections say, blended.
    pub fn solve(
        &self,
        pixel: usize,
        solve: impl Fn(usize) -> Result<Solved, MaskReason>,
    ) -> Result<Solved, MaskReason> {
        let Some(shares) = &self.shares else { return solve(0) };
        // A pixel without sections is masked before it comes here; its light is nowhere in the table.
        let Some([(own, weight), (other, _)]) = shares[pixel] else { return Err(MaskReason::Background) };
        let solved = solve(own)?;
        if weight == 1.0 { Ok(solved) } else { Ok(solved.blend(weight, solve(other)?)) }
    }
}

/// What was prepared of a table, by f_x (as bits), method, outside, noise.
type Ready = Mutex<Vec<((Vec<u64>, Method, Outside, bool), Arc<Vec<Prepared>>)>>;

/// All sections of a table, or all of its pairs of g and n, each made on a thread of its own; once for all instances of a run that ask for the same.
pub fn prepare(
    lut: &Lut,
    f_x: &[f64],
    params: &Params,
    noise: bool,
    ctx: Ctx<'_>,
) -> Result<Arc<Vec<Prepared>>, Error> {
    if noise && lut::has_unknown_errors(lut) {
        ctx.warn("the table does not know its standard errors: those of the maps hold the reflectance's alone");
    }
    let ready = lut.0.made(|_| Ready::default());
    let key = (f_x.iter().map(|f| f.to_bits()).collect::<Vec<_>>(), params.method, params.outside, noise);
    let find = || {
        let ready = ready.lock().unwrap_or_else(PoisonError::into_inner);
        ready.iter().find(|(known, _)| *known == key).map(|(_, prepared)| prepared.clone())
    };
    if let Some(prepared) = find() {
        return Ok(prepared);
    }
    // Without the lock: the threads that make it may belong to somebody who waits for it.
    let all = ctx.map_tiles(lut::parts(lut), |k| Prepared::new(lut, k, f_x, params, noise))?;
    let made: Arc<Vec<Prepared>> = Arc::new(all.into_iter().collect::<Result<_, _>>()?);
    if let Some(prepared) = find() {
        return Ok(prepared);
    }
    ready.lock().unwrap_or_else(PoisonError::into_inner).push((key, made.clone()));
    Ok(made)
}
