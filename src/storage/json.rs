//! JSON whose errors say where: the key as well as the line.

use serde::de::DeserializeOwned;

use super::kinds::in_words;

/// The value of a text, or what is wrong and where: `slices[3].z: invalid type: null, expected a number at line 7 column 12`.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    // Keys are followed only where something is wrong: it takes time.
    serde_json::from_str(text).map_err(|e| {
        let again = serde_path_to_error::deserialize::<_, T>(&mut serde_json::Deserializer::from_str(text));
        match again.err().map(|told| told.path().to_string()) {
            // What is not read as far as its key has none.
            Some(path) if path.chars().any(char::is_alphanumeric) => format!("{path}: {}", in_words(&e.to_string())),
            _ => in_words(&e.to_string()),
        }
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn what_is_wrong_is_told_with_its_key_where_it_has_one() {
        let wrong = |text: &str| parse::<BTreeMap<String, Vec<Vec<f64>>>>(text).expect_err(text);
        assert_eq!(parse::<Vec<f64>>("[1, 2.5]"), Ok(vec![1.0, 2.5]));
        assert_eq!(
            wrong(r#"{"a": [], "b": [[1], [2, null]]}"#),
            "b[1][1]: invalid type: null, expected a number at line 1 column 29"
        );
        assert_eq!(wrong(r#"{"a": [[NaN]]}"#), "a[0][0]: expected value at line 1 column 9");
        assert!(wrong("{").starts_with("EOF while parsing an object"), "{}", wrong("{"));
        assert!(wrong("[]").starts_with("invalid type: sequence"), "{}", wrong("[]"));
        assert!(wrong("{} x").starts_with("trailing characters"), "{}", wrong("{} x"));
    }
}
