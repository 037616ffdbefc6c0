//! The program `carom-bench`: an allocator, and the library.

use std::process::ExitCode;

use mimalloc::MiMalloc;

/// That of the programs which are measured.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    carom_bench::run()
}
