//! Text from files, made safe to print.

/// Text from a file as part of one line: control characters escaped, long text cut.
pub fn shown(text: &str) -> String {
    const LONGEST: usize = 200;
    let mut line: String = text.chars().take(LONGEST).flat_map(|c| escape(c).collect::<Vec<_>>()).collect();
    if text.chars().count() > LONGEST {
        line.push_str("...");
    }
    line
}

fn escape(c: char) -> Box<dyn Iterator<Item = char>> {
    if c.is_control() { Box::new(c.escape_default()) } else { Box::new(std::iter::once(c)) }
}
