//! Connection to the display, and the error message if there is none.

use carom_text::text;
use winit::event_loop::EventLoop;

/// Reason why pictures cannot be shown in a window.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// The system opens no window.
    #[error("{advice}: {reason}")]
    NotOpened {
        /// The relevant environment variables, and advice.
        advice: String,
        /// The error of the windowing library.
        reason: String,
    },
    /// No presentation works on the window.
    #[error(
        "the window cannot be drawn on ({tried}). A Vulkan driver helps, on Debian or Ubuntu \
         `apt install mesa-vulkan-drivers`; `{instead}` needs none"
    )]
    NotDrawnOn {
        /// Each presentation that was tried, with its error.
        tried: String,
        /// A command that does without a window.
        instead: &'static str,
    },
}

impl WindowError {
    /// The error of a system that opens no window for this `reason`; the command `instead` does without one.
    pub fn not_opened(instead: &str, reason: impl ToString) -> Self {
        let variable = |name: &str| match std::env::var(name) {
            Ok(value) => format!("{name}={value}"),
            Err(_) => text!("variable-not-set", name = name),
        };
        Self::NotOpened {
            advice: text!(
                "window-not-opened",
                wayland = variable("WAYLAND_DISPLAY"),
                x11 = variable("DISPLAY"),
                instead = instead
            ),
            reason: reason.to_string(),
        }
    }
}

/// Whether no window can be opened because no display is named in the environment. Only on Linux; other
/// systems always have a display.
pub fn is_displayless() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(target_os = "linux") && !is_set("DISPLAY") && !is_set("WAYLAND_DISPLAY")
}

/// Opens the connection to the display. A missing system library makes winit panic or fail, depending on
/// which it is; both become the same error, which names the command `instead`.
///
/// # Errors
/// [`WindowError::NotOpened`] if there is no display.
pub fn open_event_loop<T: 'static>(instead: &str) -> Result<EventLoop<T>, WindowError> {
    // Silences winit's panic, which becomes an error below.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let opened = std::panic::catch_unwind(|| EventLoop::<T>::with_user_event().build());
    std::panic::set_hook(hook);
    match opened {
        Ok(Ok(event_loop)) => Ok(event_loop),
        Ok(Err(error)) => Err(WindowError::not_opened(instead, reason(&error.to_string()))),
        Err(panic) => Err(WindowError::not_opened(instead, panic_words(&*panic))),
    }
}

/// The reason in winit's error, without the location in its source that precedes it.
fn reason(error: &str) -> &str {
    let after_file = error.rsplit_once(".rs:").map_or(error, |(_, rest)| rest);
    after_file.split_once(": ").map_or(error, |(_, why)| why)
}

fn panic_words(panic: &(dyn std::any::Any + Send)) -> &str {
    let words = panic.downcast_ref::<String>().map(String::as_str);
    words
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or(text!("window-library-failed"))
}
