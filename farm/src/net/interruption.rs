//! Ctrl-C, and what service managers send instead.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that turns true at the first Ctrl-C or SIGTERM, which then no longer end the program.
///
/// # Errors
/// If the system has no thread left.
pub fn interruption() -> io::Result<Arc<AtomicBool>> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    std::thread::Builder::new()
        .name("carom-signals".into())
        .spawn(move || {
            runtime.block_on(interrupted());
            raised.store(true, Ordering::Relaxed);
        })?;
    Ok(flag)
}

/// Waits for Ctrl-C or SIGTERM; for ever where the system does not tell.
pub(crate) async fn interrupted() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let Ok(mut terminated) = signal(SignalKind::terminate()) else {
            return pressed().await;
        };
        tokio::select! {
            _ = terminated.recv() => {}
            () = pressed() => {}
        }
    }
    #[cfg(not(unix))]
    pressed().await;
}

async fn pressed() {
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending::<()>().await;
    }
}
