//! Bodies that become one, of which one is not drawn on slices on which others are.

/// A body that becomes one with others: its name, and on which slices of all of them it is drawn.
pub struct Member {
    /// Its name.
    pub name: String,
    /// Whether it is drawn, slice by slice.
    pub drawn: Vec<bool>,
}

impl Member {
    /// Slices between its first and its last one, and those of them that it is not drawn on.
    fn missing(&self) -> [usize; 2] {
        let places: Vec<usize> = (0..self.drawn.len()).filter(|&k| self.drawn[k]).collect();
        let between = places.first().zip(places.last()).map_or(0, |(first, last)| last - first + 1);
        [between, between - places.len()]
    }
}

/// Words where members of a union are not drawn on some slices between their first and their last one: the union is without them there, though by itself
/// each is interpolated across. `slices` is the word for these, `apart` says how members are kept apart.
pub fn drawn_on_slices_of_others(members: &[Member], slices: &str, apart: &str) -> Option<String> {
    let lacking = members.iter().map(|member| (member, member.missing())).filter(|(_, [_, missing])| *missing > 0);
    let lacking: Vec<(&Member, [usize; 2])> = lacking.collect();
    let (worst, [between, missing]) = lacking.iter().max_by_key(|(_, [between, missing])| missing * 1000 / between)?;
    let more = match lacking.len() - 1 {
        0 => String::new(),
        1 => "; so is 1 more".into(),
        count => format!("; so are {count} more"),
    };
    Some(format!(
        "{} is not drawn on {missing} of the {between} {slices} from its first to its last one, on which others are{more}: there the union is without it, \
         though by itself it is interpolated across; {apart}",
        worst.name
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(members: &[(&str, &str)]) -> Option<String> {
        let member = |(name, drawn): &(&str, &str)| Member {
            name: (*name).into(),
            drawn: drawn.chars().map(|c| c == 'x').collect(),
        };
        drawn_on_slices_of_others(&members.iter().map(member).collect::<Vec<_>>(), "planes", "keep them apart")
    }

    #[test]
    fn members_that_are_drawn_on_other_slices_are_told() {
        for members in [&[("a", "xxxx"), ("b", ".xx.")][..], &[("a", "xx.."), ("b", "..xx")], &[("a", "x"), ("b", ".")]]
        {
            assert_eq!(told(members), None);
        }
        let one = told(&[("a", "xxxxx"), ("b", "x..xx")]).expect("b lacks two");
        assert!(
            one.starts_with("b is not drawn on 2 of the 5 planes from its first to its last one, on which others are:"),
            "{one}"
        );
        let both = told(&[("a", "x.x.x."), ("b", ".x.x.x"), ("c", "xxxxxx")]).expect("a and b lack two each");
        assert!(
            both.contains(" is not drawn on 2 of the 5 planes") && both.contains("others are; so is 1 more:"),
            "{both}"
        );
        assert!(both.ends_with("; keep them apart"), "{both}");
    }
}
