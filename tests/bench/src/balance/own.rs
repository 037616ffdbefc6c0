//! A user's balancer: the file that `build.rs` has copied, an example of the farm or the one that
//! `CAROM_BALANCER` names.

use carom_farm::balancer::Balancer;

/// A new balancer, without any measurements yet.
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
