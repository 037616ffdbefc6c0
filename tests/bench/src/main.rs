//! The program `carom-bench`: an allocator, and the library.

use std::process::ExitCode;

use mimalloc::MiMalloc;

/// The allocator of the programs that are measured.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    carom_bench::run()
}
