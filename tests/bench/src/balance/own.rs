//! Balancer from outside: the file that `build.rs` has copied, an example of the farm or what
//! `CAROM_BALANCER` names.

use carom_farm::balancer::Balancer;

/// A new one, that has learned nothing.
pub(super) fn balancer() -> Box<dyn Balancer + Send> {
    Box::new(file::MyBalancer::default())
}

#[expect(
    dead_code,
    unreachable_pub,
    reason = "a program of its own: its `main` is not called here"
)]
mod file {
    include!(concat!(env!("OUT_DIR"), "/own_balancer.rs"));
}
