//! Points of the unit cube in ten dimensions as CSV, by method, number of points and seed, for `compare.py` beside it:
//!
//! ```sh
//! cargo run --release -p turbid-draw --example points > points.csv
//! python3 stages/draw/examples/compare.py points.csv
//! ```

use std::io::{self, BufWriter, Write};

use serde_json::{Value, json};
use turbid_draw::Draw;

const DIMENSIONS: usize = 10;
const NUMBERS: [u64; 7] = [64, 128, 256, 512, 1024, 2048, 4096];
const SEEDS: u64 = 16;

fn main() -> io::Result<()> {
    let mut to = BufWriter::new(io::stdout().lock());
    let names: Vec<String> = (0..DIMENSIONS).map(|dimension| format!("x{dimension}")).collect();
    writeln!(to, "method,n,seed,{}", names.join(","))?;
    for method in ["sobol", "lhs", "random"] {
        for n in NUMBERS {
            let mut entries: Vec<(String, Value)> =
                names.iter().map(|name| (name.clone(), json!({"uniform": [0, 1]}))).collect();
            entries.extend([("n".to_owned(), json!(n)), ("method".to_owned(), json!(method))]);
            let draw = Draw::read(&entries, n).expect("it is a draw");
            for (seed, index) in (0..SEEDS).flat_map(|seed| (0..n).map(move |index| (seed, index))) {
                let point = draw.point(seed, index).expect("nothing is skipped");
                let values: Vec<String> = point.iter().map(Value::to_string).collect();
                writeln!(to, "{method},{n},{seed},{}", values.join(","))?;
            }
        }
    }
    to.flush()
}
