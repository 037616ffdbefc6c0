//! Selection of a bench's cases by name.

use crate::BenchError;

/// The cases whose name contains `part`; all cases without it.
///
/// # Errors
/// [`BenchError::Input`] with the existing names, if none matches.
pub(crate) fn named<T>(
    cases: impl IntoIterator<Item = T>,
    name: impl Fn(&T) -> &str,
    part: Option<&str>,
) -> Result<Vec<T>, BenchError> {
    let Some(part) = part else {
        return Ok(cases.into_iter().collect());
    };
    let is_wanted = |case: &T| name(case).contains(part);
    let (wanted, others): (Vec<T>, Vec<T>) = cases.into_iter().partition(is_wanted);
    if wanted.is_empty() {
        let names: Vec<&str> = others.iter().map(name).collect();
        return Err(BenchError::Input(format!(
            "no path has `{}` in its name; there are: {}",
            part.escape_debug(),
            names.join("; ")
        )));
    }
    Ok(wanted)
}
