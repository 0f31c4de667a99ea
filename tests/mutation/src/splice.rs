//! Insertions and replacements in a text, whose nesting is kept.

use std::ops::Range;

struct Edit {
    at: usize,
    order: i64,
    until: usize,
    text: String,
    wrap: usize,
}

/// Edits of a text. An outer expression is wrapped before those in it.
#[derive(Default)]
pub struct Splice {
    edits: Vec<Edit>,
    wraps: usize,
}

impl Splice {
    /// Wraps the bytes `range`: `before` opens, `after` closes.
    pub fn wrap(&mut self, range: Range<usize>, before: String, after: String) {
        // What closes stands before what opens at the same place; of several, the inner one opens last and closes first.
        let (wrap, order) = (self.wraps, self.wraps as i64 + 1);
        self.wraps += 1;
        self.edits.push(Edit { at: range.start, order, until: range.start, text: before, wrap });
        self.edits.push(Edit { at: range.end, order: -order, until: range.end, text: after, wrap });
    }

    /// Puts `text` in place of the bytes `range`, in which nothing else is edited.
    pub fn replace(&mut self, range: Range<usize>, text: String) {
        self.edits.push(Edit { at: range.start, order: i64::MAX, until: range.end, text, wrap: usize::MAX });
    }

    /// The edited text, and the bytes of it that each wrap holds, in the order in which they were asked for.
    pub fn finish(mut self, old: &str) -> (String, Vec<Range<usize>>) {
        self.edits.sort_by_key(|edit| (edit.at, edit.order));
        let mut new = String::with_capacity(4 * old.len());
        let mut held = vec![0..0; self.wraps];
        let mut done = 0;
        for edit in &self.edits {
            new.push_str(&old[done..edit.at]);
            done = edit.until;
            if let Some(held) = held.get_mut(edit.wrap).filter(|_| edit.order > 0) {
                held.start = new.len();
            }
            new.push_str(&edit.text);
            if let Some(held) = held.get_mut(edit.wrap).filter(|_| edit.order < 0) {
                held.end = new.len();
            }
        }
        new.push_str(&old[done..]);
        (new, held)
    }
}
