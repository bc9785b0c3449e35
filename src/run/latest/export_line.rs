//! The command that writes an output as a file, as a shell takes it.

use std::borrow::Cow;
use std::path::Path;

use crate::plan::Plan;

use super::file_name;

/// Where results are kept unless somebody says otherwise.
const USUAL: &str = "outputs";

/// `turbid export` of one run: its pipeline file, overrides and outputs. To be typed where the run was.
pub struct Command {
    file: String,
    tail: String,
}

impl Command {
    pub fn of(plan: &Plan, outputs: &Path) -> Self {
        let file = plan.spec.sources.first().map_or("", |source| source.name.as_str());
        let mut tail: String = plan.spec.overrides.iter().map(|given| format!(" --set {}", quoted(given))).collect();
        if outputs != Path::new(USUAL) {
            tail.push_str(&format!(" --outputs {}", quoted(&outputs.to_string_lossy())));
        }
        Self { file: quoted(file).into_owned(), tail }
    }

    /// The run itself.
    pub fn run(&self) -> String {
        format!("turbid run {}{}", self.file, self.tail)
    }

    /// The run of these targets, all leaves where there are none.
    pub fn run_of(&self, targets: &[String]) -> String {
        self.command("run", targets)
    }

    /// Another command on these targets.
    pub fn command(&self, name: &str, targets: &[String]) -> String {
        let targets: String = targets.iter().map(|target| format!(" {}", quoted(target))).collect();
        format!("turbid {name} {}{targets}{}", self.file, self.tail)
    }

    /// Of one instance, by the text of its axes.
    pub fn one(&self, stage: &str, axes: &str, port: &str) -> String {
        let (selected, named) = match axes.is_empty() {
            true => (format!("{stage}.{port}"), format!("{stage}.{port}.npz")),
            false => (format!("{stage}[{axes}].{port}"), format!("{stage},{axes}.{port}.npz")),
        };
        self.line(&selected, &file_name(&named))
    }

    /// Of all instances of a stage, each to a file that its axes name.
    pub fn all(&self, stage: &str, port: &str, axes: &[&str]) -> String {
        let places: String = axes.iter().map(|axis| format!(",{axis}={{{axis}}}")).collect();
        self.line(&format!("{stage}.{port}"), &format!("{stage}{places}.{port}.npz"))
    }

    fn line(&self, selected: &str, to: &str) -> String {
        format!("turbid export {} {} --to {}{}", self.file, quoted(selected), quoted(to), self.tail)
    }
}

/// As one word of a POSIX shell.
fn quoted(text: &str) -> Cow<'_, str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./=,:+%@".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.into();
    }
    format!("'{}'", text.replace('\'', "'\\''")).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_shell_are_quoted_where_they_must_be() {
        let words = ["p.yaml", "a b.yaml", "it's", "a[x=1].p", "", "$HOME"].map(quoted);
        assert_eq!(words, ["p.yaml", "'a b.yaml'", "'it'\\''s'", "'a[x=1].p'", "''", "'$HOME'"]);
    }
}
