//! A program's arguments.

/// Takes the options of these `names`, each with a value behind it or behind `=`, out of a
/// program's arguments, and gives them to `take`. Returns the others, in their order. What follows
/// `--` are no options.
///
/// # Errors
///
/// The first of `take`.
pub fn take_options<E>(
    arguments: impl IntoIterator<Item = String>,
    names: &[&'static str],
    mut take: impl FnMut(&'static str, String) -> Result<(), E>,
) -> Result<Vec<String>, E> {
    let mut others = Vec::new();
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        let (name, value) = match argument.split_once('=') {
            Some((name, value)) => (name, Some(value.to_owned())),
            None => (&*argument, None),
        };
        if let Some(option) = names.iter().find(|option| **option == name) {
            let value = value.or_else(|| arguments.next());
            take(option, value.unwrap_or_default())?;
            continue;
        }
        let is_last = argument == "--";
        others.push(argument);
        if is_last {
            others.extend(arguments);
            break;
        }
    }
    Ok(others)
}
