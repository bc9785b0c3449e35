//! `turbid graph`: the stages and how they feed each other, as Mermaid or DOT.

use clap::{Args, ValueEnum};

use crate::plan::{Id, Plan};
use crate::registry::Registry;

use super::{Done, Pipeline, print};

#[derive(Args)]
pub struct Graph {
    #[command(flatten)]
    pipeline: Pipeline,
    #[arg(long, value_enum, default_value_t = Format::Mermaid)]
    format: Format,
}

#[derive(Clone, Copy, ValueEnum)]
enum Format {
    Mermaid,
    Dot,
}

impl Graph {
    pub fn run(&self, registry: &Registry) -> Done {
        let plan = self.pipeline.plan(registry, &[])?;
        print(&draw(&plan, self.format));
        Ok(())
    }
}

fn draw(plan: &Plan, format: Format) -> String {
    let mut text = match format {
        Format::Mermaid => "flowchart LR\n".to_owned(),
        Format::Dot => "digraph pipeline {\n  rankdir=LR;\n  node [shape=box];\n".to_owned(),
    };
    for (id, stage) in plan.spec.stages.iter_ids() {
        let (index, count) = (id.place(), plan.instances_of(id).len());
        let times = if count == 1 { String::new() } else { format!(" × {count}") };
        let line = match format {
            Format::Mermaid => format!("  s{index}[\"{}{times}<br/>{}\"]\n", stage.name, stage.use_name),
            Format::Dot => format!("  s{index} [label=\"{}{times}\\n{}\"];\n", stage.name, stage.use_name),
        };
        text.push_str(&line);
    }
    for edge in plan.edges() {
        let (from, to, label) = (edge.from.place(), edge.to.place(), edge.label());
        text.push_str(&match format {
            Format::Mermaid => format!("  s{from} -->|{label}| s{to}\n"),
            Format::Dot => format!("  s{from} -> s{to} [label=\"{label}\"];\n"),
        });
    }
    if matches!(format, Format::Dot) {
        text.push_str("}\n");
    }
    text
}
