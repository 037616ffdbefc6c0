//! Every tracer of the crate: each law is tested on each of them.

use carom_tracer::{Reference, Tracer};

/// One line per back end; those whose device this machine lacks are left out.
pub(crate) fn tracers() -> Vec<Box<dyn Tracer>> {
    vec![Box::new(Reference)]
}
