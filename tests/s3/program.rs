//! turbid with the feature `s3`.

fn main() -> std::process::ExitCode {
    turbid::cli::main(turbid::registry::Registry::builtin())
}
