//! Values of options: negative numbers are values and no options, and what is no number is told in words.

use std::any::TypeId;

use clap::Arg;

/// An option whose values may begin with a minus sign, where it takes numbers, lists of them, or one of some words.
pub fn told(option: Arg) -> Arg {
    if option.is_positional() || !option.get_action().takes_values() {
        return option;
    }
    let of = option.get_value_parser().type_id();
    let option = if of == TypeId::of::<f64>() {
        option.value_parser(number)
    } else if of == TypeId::of::<usize>() {
        option.value_parser(count)
    } else if of == TypeId::of::<i64>() {
        option.value_parser(whole)
    } else if option.get_possible_values().is_empty() {
        return option;
    } else {
        option
    };
    // Not `allow_negative_numbers`, which knows neither `-1,2` nor `-1e-3`, nor says of `--axis -z` which axes there are.
    option.allow_hyphen_values(true)
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| "expected a number".into())
}

fn count(text: &str) -> Result<usize, String> {
    text.trim().parse().map_err(|_| "expected a whole number, 0 or more".into())
}

fn whole(text: &str) -> Result<i64, String> {
    text.trim().parse().map_err(|_| "expected a whole number".into())
}
