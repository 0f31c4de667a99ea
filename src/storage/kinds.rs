//! What serde says of a value of the wrong kind, with people's names of kinds.

/// `invalid type: string "x", expected f64 at line 1 column 3` as `..., expected a number at line 1 column 3`.
pub fn in_words(message: &str) -> String {
    const EXPECTED: &str = ", expected ";
    let Some((found, rest)) = message.rsplit_once(EXPECTED) else { return message.into() };
    let (kind, place) = rest.split_at(rest.find(" at line ").unwrap_or(rest.len()));
    let kind = match kind {
        "f32" | "f64" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number from 0",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number",
        "a boolean" => "true or false",
        "a string" => "a text",
        "a sequence" => "a list",
        kind if kind.starts_with("struct ") || kind == "a map" => "values with names",
        kind => kind,
    };
    let kind = kind.strip_prefix("an array of length ").map_or_else(|| kind.into(), |n| format!("a list of {n}"));
    format!("{found}{EXPECTED}{kind}{place}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_the_names_that_people_give_them() {
        for (told, words) in [
            (
                "invalid type: string \"a, expected f64\", expected f64",
                "invalid type: string \"a, expected f64\", expected a number",
            ),
            (
                "invalid type: null, expected u32 at line 2 column 7",
                "invalid type: null, expected a whole number from 0 at line 2 column 7",
            ),
            ("invalid length 3, expected an array of length 2", "invalid length 3, expected a list of 2"),
            ("invalid type: sequence, expected struct Link", "invalid type: sequence, expected values with names"),
            ("unknown variant `x`, expected `a` or `b`", "unknown variant `x`, expected `a` or `b`"),
            ("expected value at line 1 column 9", "expected value at line 1 column 9"),
        ] {
            assert_eq!(in_words(told), words);
        }
    }
}
