//! How a line of text becomes cells.

/// What stands between the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Separator {
    Sign(char),
    /// Any number of blanks and tabs; without quotes.
    Blanks,
}

impl Separator {
    /// The first of some signs that a line has.
    pub(crate) fn of(line: &str, signs: &[char]) -> Option<Self> {
        signs.iter().find(|&&sign| line.contains(sign)).map(|&sign| Self::Sign(sign))
    }
}

/// The cells of a line, without blanks and quotes around them.
#[derive(Debug, Default)]
pub(crate) struct Cells {
    text: String,
    ends: Vec<usize>,
}

impl Cells {
    /// Takes the cells of a row. A cell that begins with a quote goes on to the next one; two quotes
    /// in it are one. Without `has_quotes` they are characters.
    ///
    /// Returns whether a quote is still open at the end, so that the row goes on in the next line.
    pub(crate) fn split(&mut self, row: &str, separator: Separator, has_quotes: bool) -> bool {
        self.text.clear();
        self.ends.clear();
        let sign = match separator {
            Separator::Blanks => {
                row.split_ascii_whitespace().for_each(|word| self.push(word));
                return false;
            }
            Separator::Sign(sign) => sign,
        };
        if !has_quotes || !row.contains('"') {
            row.split(sign).for_each(|cell| self.push(cell.trim()));
            return false;
        }
        let mut rest = row;
        loop {
            let cell = rest.trim_start();
            let Some(mut quoted) = cell.strip_prefix('"') else {
                let (cell, after) =
                    cell.split_once(sign).map_or((cell, None), |(cell, after)| (cell, Some(after)));
                self.push(cell.trim());
                match after {
                    Some(after) => rest = after,
                    None => return false,
                }
                continue;
            };
            let start = self.text.len();
            let after = loop {
                let Some((part, after)) = quoted.split_once('"') else { return true };
                self.text.push_str(part);
                match after.strip_prefix('"') {
                    Some(after) => (self.text.push('"'), quoted = after).1,
                    None => break after,
                }
            };
            // What stands between the quote and the end of the cell belongs to it.
            let (more, after) =
                after.split_once(sign).map_or((after, None), |(more, after)| (more, Some(after)));
            self.text.push_str(more.trim_end());
            let cell = self.text.split_off(start);
            self.push(cell.trim());
            match after {
                Some(after) => rest = after,
                None => return false,
            }
        }
    }

    fn push(&mut self, cell: &str) {
        self.text.push_str(cell);
        self.ends.push(self.text.len());
    }

    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    pub(crate) fn get(&self, k: usize) -> Option<&str> {
        let start = k.checked_sub(1).map_or(0, |before| self.ends.get(before).copied().unwrap_or_default());
        self.text.get(start..*self.ends.get(k)?)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &str> {
        (0..self.len()).filter_map(|k| self.get(k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_no_blanks_and_quotes_around_them() {
        let split = |row: &str, sign| {
            let mut cells = Cells::default();
            let is_open = cells.split(row, Separator::Sign(sign), true);
            (cells.iter().map(str::to_owned).collect::<Vec<_>>(), is_open)
        };
        assert_eq!(
            split(" a ,, \"b, \"\"c\"\" \" ,d\"e", ','),
            (vec!["a", "", "b, \"c\"", "d\"e"].into_iter().map(str::to_owned).collect(), false)
        );
        assert_eq!(split("\t1\t", '\t').0, ["", "1", ""], "the first and the last cell may be empty");
        assert!(split("a,\"b", ',').1, "a quote that is not closed");
    }
}
