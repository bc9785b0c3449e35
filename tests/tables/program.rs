//! turbid with the feature `tables`.

fn main() -> std::process::ExitCode {
    turbid::cli::main(turbid::registry::Registry::builtin())
}
