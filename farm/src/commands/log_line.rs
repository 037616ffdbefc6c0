//! Event lines on standard output of long-running commands.

use std::io::Write as _;

use carom_farm::logging::{LogFormat, timestamp};
use serde_json::json;

/// Prints a line whose first word names the event. Errors are ignored, so that a reader that has closed the
/// pipe does not end the program.
pub(crate) fn print(format: LogFormat, line: &str) {
    let _ = writeln!(std::io::stdout(), "{}", formatted(format, line));
}

fn formatted(format: LogFormat, line: &str) -> String {
    match format {
        LogFormat::Plain => line.to_owned(),
        LogFormat::Time => format!("{} {line}", timestamp()),
        LogFormat::Json => {
            let event = line.split([' ', ':']).next();
            json!({"timestamp": timestamp(), "event": event, "message": line}).to_string()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_the_time_first_or_are_json() {
        let line = "lost 1.2.3.4:5: it said \"no\"";
        assert_eq!(formatted(LogFormat::Plain, line), line);
        let timed = formatted(LogFormat::Time, line);
        let (time, rest) = timed.split_once(' ').unwrap();
        assert!(time.ends_with('Z') && time.len() > 19, "{time}");
        assert_eq!(rest, line);
        let json: serde_json::Value =
            serde_json::from_str(&formatted(LogFormat::Json, line)).unwrap();
        assert_eq!(
            (&json["event"], &json["message"]),
            (&"lost".into(), &line.into())
        );
    }
}
