//! Bodies that become one, of which one is not drawn on slices on which others are.

use crate::stack::ContourStack;

/// A gap between slices on which a member is drawn is one of its row up to so many of its middle ones: a slice left out is twice as wide.
const OF_ROW: f64 = 1.5;
/// Slices that make a row: from one gap nobody knows whether it is one or a hole.
const ROW: usize = 3;

/// A body that becomes one with others: its name, and on which slices of all of them it is drawn.
pub struct Member {
    /// Its name.
    pub name: String,
    /// Whether it is drawn, slice by slice.
    pub drawn: Vec<bool>,
}

/// Slices of a member from its first to its last one, those of them within its row that others are drawn on alone, and those beyond it.
struct Lacking {
    between: usize,
    of_row: Vec<usize>,
    beyond: usize,
}

impl Member {
    /// The slices on which it is drawn.
    pub fn places(&self) -> Vec<usize> {
        (0..self.drawn.len()).filter(|&k| self.drawn[k]).collect()
    }

    /// Slices at heights `z` on which others are drawn alone, between those of its row: it has slices of its own, and is interpolated across these.
    pub fn between(&self, z: &[f64]) -> Vec<usize> {
        self.lacking(z).of_row
    }

    fn lacking(&self, z: &[f64]) -> Lacking {
        let places = self.places();
        let between = places.first().zip(places.last()).map_or(0, |(first, last)| last - first + 1);
        let gap = |pair: &[usize]| z[pair[1]] - z[pair[0]];
        let mut gaps: Vec<f64> = places.windows(2).map(gap).collect();
        gaps.sort_by(f64::total_cmp);
        let widest = if places.len() < ROW { 0.0 } else { OF_ROW * gaps[(gaps.len() - 1) / 2] };
        let rows = places.windows(2).filter(|pair| gap(pair) <= widest);
        let of_row: Vec<usize> = rows.flat_map(|pair| pair[0] + 1..pair[1]).collect();
        Lacking { between, beyond: between - places.len() - of_row.len(), of_row }
    }
}

/// A member with slices of its own, which is interpolated to those of others before the union.
#[derive(Debug, Clone)]
pub struct InterpolatedMember {
    /// Its name.
    pub name: String,
    /// It by itself, on the pixels of the union.
    pub stack: ContourStack,
    /// The union's slices to which it is interpolated.
    pub slices: Vec<usize>,
}

/// Words where members of a union are not drawn on some slices, at heights `z`, between their first and their last one, on which others are.
/// `is_interpolated` says whether those with slices of their own are interpolated to these. `slices` is the word for them, `apart` says how members are kept
/// apart.
pub fn drawn_on_slices_of_others(
    members: &[Member],
    z: &[f64],
    is_interpolated: bool,
    [slices, apart]: [&str; 2],
) -> Option<String> {
    let (mut interpolated, mut left_out) = (Vec::new(), Vec::new());
    for member in members {
        let Lacking { between, of_row, beyond } = member.lacking(z);
        let [row, without] = if is_interpolated { [of_row.len(), beyond] } else { [0, of_row.len() + beyond] };
        interpolated.extend((row > 0).then_some((&*member.name, row, between)));
        left_out.extend((without > 0).then_some((&*member.name, without, between)));
    }
    let words = |lacking: &[(&str, usize, usize)], what: &str| {
        let (name, missing, between) = lacking.iter().max_by_key(|(_, missing, between)| missing * 1000 / between)?;
        let more = match lacking.len() - 1 {
            0 => String::new(),
            1 => "; so is 1 more".into(),
            count => format!("; so are {count} more"),
        };
        Some(format!(
            "{name} is not drawn on {missing} of the {between} {slices} from its first to its last one, on which others are{more}: {what}"
        ))
    };
    let all = [
        words(&interpolated, "there it is interpolated by itself before the union"),
        words(&left_out, "there the union is without it, though by itself it is interpolated across"),
    ];
    let all: Vec<String> = all.into_iter().flatten().collect();
    (!all.is_empty()).then(|| format!("{}; {apart}", all.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member((name, drawn): &(&str, &str)) -> Member {
        Member { name: (*name).into(), drawn: drawn.chars().map(|c| c == 'x').collect() }
    }

    fn told(members: &[(&str, &str)], is_interpolated: bool) -> Option<String> {
        let members: Vec<Member> = members.iter().map(member).collect();
        let z: Vec<f64> = (0..members[0].drawn.len()).map(|k| k as f64).collect();
        drawn_on_slices_of_others(&members, &z, is_interpolated, ["planes", "keep them apart"])
    }

    #[test]
    fn members_that_are_drawn_on_other_slices_are_told() {
        for members in [&[("a", "xxxx"), ("b", ".xx.")][..], &[("a", "xx.."), ("b", "..xx")], &[("a", "x"), ("b", ".")]]
        {
            assert_eq!(told(members, true), None);
        }
        let one = told(&[("a", "xxxxx"), ("b", "x..xx")], true).expect("b lacks two");
        let lacks = "b is not drawn on 2 of the 5 planes from its first to its last one, on which others are: ";
        assert!(one.starts_with(&format!("{lacks}there the union is without it")), "{one}");
        let both = told(&[("a", "x.x.x."), ("b", ".x.x.x"), ("c", "xxxxxx")], true).expect("a and b lack two each");
        assert!(
            both.contains(" is not drawn on 2 of the 5 planes") && both.contains("so is 1 more: there it is inter"),
            "{both}"
        );
        assert!(both.ends_with("; keep them apart") && !both.contains("without"), "{both}");
        let both = told(&[("a", "x.x.x.x.....x"), ("c", "xxxxxxxxxxxxx")], true).expect("a lacks a row and a hole");
        for words in ["3 of the 13 planes", "5 of the 13 planes", "interpolated by itself", "without it"] {
            assert!(both.contains(words), "{both}");
        }
        let none = told(&[("a", "x.x.x."), ("c", "xxxxxx")], false).expect("a lacks two");
        assert!(!none.contains("interpolated by itself"), "{none}");
    }

    #[test]
    fn a_member_is_interpolated_within_its_row() {
        let z: Vec<f64> = (0..13).map(f64::from).collect();
        let between = |drawn: &str| member(&("a", drawn)).between(&z);
        assert_eq!(between("x.x.x........"), [1, 3]);
        assert_eq!(between("..x..x..x...."), [3, 4, 6, 7]);
        // A gap twice as wide is a hole; one that is hardly wider is none.
        assert_eq!(between("x.x.x...x.x.."), [1, 3, 9]);
        assert_eq!(between("x..x..x...x.."), [1, 2, 4, 5, 7, 8, 9]);
        // Of two slices nobody knows; what is drawn slice by slice has a hole.
        assert_eq!(between("x...x........"), [0; 0]);
        assert_eq!(between("xxxx.xxxx...."), [0; 0]);
    }
}
