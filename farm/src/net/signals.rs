//! Signals that ask a program to end: Ctrl-C, and SIGTERM from service managers.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::net::runtime;

/// A flag that becomes true at the first Ctrl-C or SIGTERM; neither ends the program from here on.
///
/// # Errors
/// If the system can start no thread or does not deliver signals.
pub fn interruption() -> Result<Arc<AtomicBool>, io::Error> {
    let runtime = runtime::waiting_thread()?;
    let mut signals = {
        let _inside = runtime.enter();
        Signals::listen()?
    };
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    std::thread::Builder::new()
        .name("carom-signals".into())
        .spawn(move || {
            runtime.block_on(signals.recv());
            raised.store(true, Ordering::Relaxed);
        })?;
    Ok(flag)
}

/// Stream of Ctrl-C and SIGTERM, which do not end the program from [`Signals::listen`] on.
pub(crate) struct Signals {
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
    #[cfg(windows)]
    interrupt: tokio::signal::windows::CtrlC,
}

impl Signals {
    /// Catches signals from now on; must be called inside a runtime.
    #[cfg(unix)]
    pub(crate) fn listen() -> Result<Self, io::Error> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
        })
    }

    /// Catches signals from now on; must be called inside a runtime.
    #[cfg(windows)]
    pub(crate) fn listen() -> Result<Self, io::Error> {
        let interrupt = tokio::signal::windows::ctrl_c()?;
        Ok(Self { interrupt })
    }

    /// Waits for the next signal; one that came before the call counts.
    pub(crate) async fn recv(&mut self) {
        #[cfg(unix)]
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
        #[cfg(windows)]
        self.interrupt.recv().await;
    }
}
