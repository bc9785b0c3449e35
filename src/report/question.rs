//! The comment that a pipeline file begins with: what it asks, how long it takes, what to expect.

use super::page::Block;

/// The head comment in paragraphs; lines that are set in by two blanks or more stay lines.
pub fn question(text: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut open = false;
    for line in text.lines().map_while(|line| line.strip_prefix('#')) {
        let line = line.strip_prefix(' ').unwrap_or(line).trim_end();
        if line.is_empty() {
            open = false;
            continue;
        }
        let set_in = line.starts_with("  ");
        match blocks.last_mut().filter(|_| open) {
            Some(Block::Lines(text)) if set_in => {
                text.push('\n');
                text.push_str(line);
            }
            Some(Block::Paragraph(text)) if !set_in => {
                text.push(' ');
                text.push_str(line);
            }
            _ => blocks.push(if set_in { Block::Lines(line.to_owned()) } else { Block::Paragraph(line.to_owned()) }),
        }
        open = true;
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_are_joined_and_tables_kept() {
        let text = "# Question: what?\n# More.\n#\n# Expected:\n#   a  1\n#   b  2\n# End.\npipeline: p\n# no head\n";
        let expected = [
            Block::Paragraph("Question: what? More.".into()),
            Block::Paragraph("Expected:".into()),
            Block::Lines("  a  1\n  b  2".into()),
            Block::Paragraph("End.".into()),
        ];
        assert_eq!(question(text), expected);
        assert_eq!(question("pipeline: p\n"), []);
    }
}
