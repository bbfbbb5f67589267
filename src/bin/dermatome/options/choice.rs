//! Options with a few words as values.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A value of an option: its word, what it is to the library, and what the help says of it.
pub(crate) type Choice<T> = (&'static str, T, &'static str);

/// A parser of the words of some choices.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static>(
    choices: &'static [Choice<T>],
) -> impl TypedValueParser<Value = T> {
    let words = choices.iter().map(|(word, _, help)| PossibleValue::new(*word).help(*help));
    PossibleValuesParser::new(words).map(|word| {
        let chosen = choices.iter().find(|(other, ..)| *other == word);
        chosen.map(|(_, value, _)| value.clone()).expect("clap takes no other words")
    })
}

/// The word that chooses a value; empty if none does.
pub(crate) fn word_of<T: PartialEq>(choices: &[Choice<T>], value: &T) -> &'static str {
    choices.iter().find(|(_, other, _)| other == value).map_or("", |(word, ..)| word)
}
