//! The program with one stage more.

fn main() -> std::process::ExitCode {
    turbid::cli::main(turbid::registry::Registry::builtin().with::<own_stage::ModulationDepth>())
}
