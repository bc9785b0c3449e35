//! What a report shows, as plain data: nothing here knows files, plans or HTML.

/// A report: one page on a pipeline and what is there of its results.
#[derive(Debug, Default)]
pub struct Page {
    pub pipeline: String,
    pub about: Option<String>,
    /// The comment that the file begins with.
    pub question: Vec<Block>,
    /// What is there: `11 of 11 instances are up to date`.
    pub state: String,
    /// A way on, where results are missing.
    pub hint: Option<String>,
    /// Metrics with their errors.
    pub figures: Vec<Grid>,
    pub figure_notes: Vec<String>,
    pub studies: Vec<Study>,
    /// Stages in the order of the file, those of the results first.
    pub shown: Vec<Shown>,
    pub picture_notes: Vec<String>,
    pub nodes: Vec<Node>,
    pub edges: Vec<Edge>,
    pub stages: Grid,
    pub costs: Grid,
    pub cost_notes: Vec<Cell>,
    pub measures: Option<Grid>,
    pub params: Vec<(String, Grid)>,
    pub warnings: Vec<String>,
    pub left_out: Vec<(String, Vec<String>)>,
    pub provenance: Grid,
    pub instances: Grid,
}

/// A piece of a comment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Block {
    Paragraph(String),
    /// Lines that were set in: tables, lists.
    Lines(String),
}

/// What stands in a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cell {
    Text(String),
    /// Seconds, memory, dates, machines: what differs between two runs of the same work. Marked in the page.
    Run(String),
    Link {
        text: String,
        href: String,
    },
}

impl Cell {
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    pub fn run(text: impl Into<String>) -> Self {
        Self::Run(text.into())
    }
}

/// A table.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    pub caption: String,
    pub head: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
    /// What is not in it, and where it is.
    pub more: Option<String>,
}

/// A figure with the table behind it.
#[derive(Clone, Debug)]
pub struct Figure {
    pub title: String,
    /// What somebody is told who does not see it.
    pub alt: String,
    pub image: Image,
    /// The output that it shows, as a file beside the page.
    pub file: Option<String>,
    pub behind: Option<Grid>,
}

#[derive(Clone, Debug)]
pub enum Image {
    /// A PNG file, with its size in pixels.
    Png { bytes: Vec<u8>, width: u32, height: u32 },
    /// An SVG file, as it is.
    SvgFile(Vec<u8>),
    /// An `<svg>` element of our own, which the page colours.
    Svg(String),
}

/// The figures of a stage.
#[derive(Clone, Debug)]
pub struct Shown {
    pub stage: String,
    pub figures: Vec<Figure>,
    pub notes: Vec<String>,
}

/// A study as it was run last.
#[derive(Clone, Debug)]
pub struct Study {
    pub name: String,
    pub about: Option<String>,
    pub figure: Option<Figure>,
    pub points: Option<Grid>,
    pub notes: Vec<String>,
}

/// A stage in the graph.
#[derive(Clone, Debug)]
pub struct Node {
    pub name: String,
    pub kind: String,
    pub instances: usize,
    pub state: NodeState,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeState {
    UpToDate,
    ToRun,
    Waits,
    /// Not asked for.
    LeftOut,
}

impl NodeState {
    pub fn text(self) -> &'static str {
        match self {
            Self::UpToDate => "up to date",
            Self::ToRun => "to run",
            Self::Waits => "waits",
            Self::LeftOut => "left out",
        }
    }

    pub fn class(self) -> &'static str {
        match self {
            Self::UpToDate => "done",
            Self::ToRun => "stale",
            Self::Waits => "waits",
            Self::LeftOut => "out",
        }
    }
}

/// What one stage gives another; indices of nodes, names of ports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edge {
    pub from: usize,
    pub to: usize,
    pub ports: String,
}
