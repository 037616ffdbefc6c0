//! Writes the inputs to begin from to `corpus/<target>/`.

use std::io;
use std::path::Path;

fn main() -> io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (name, _, seeds) in carom_fuzz::TARGETS {
        let folder = corpus.join(name);
        std::fs::create_dir_all(&folder)?;
        for (index, seed) in seeds().iter().enumerate() {
            std::fs::write(folder.join(format!("seed_{index}")), seed)?;
        }
    }
    Ok(())
}
