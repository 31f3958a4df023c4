//! Tokens of CSPm.

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Token {
    Word(String),
    Number(i64),
    Sign(&'static str),
    /// Where a definition may begin: a line that does not go on with the one before it.
    Line,
    End,
}

/// The longest first.
const SIGNS: [&str; 42] = [
    "|~|", "[|", "|]", "<-", "[T=", "[F]", ":[", "{|", "|}", "||", "[]", "->", "..", "==", "!=",
    "<=", ">=", "<>", "(", ")", "{", "}", "[", "]", ",", ".", "?", "!", ":", "@", "&", "\\", "=",
    "|", "+", "-", "*", "/", "%", "^", "#", "<",
];

/// The tokens, each with its line.
pub(super) fn tokens(text: &str) -> Vec<(Token, usize)> {
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let mut rest = line.split("--").next().unwrap_or("");
        if rest.starts_with(|c: char| !c.is_whitespace()) {
            found.push((Token::Line, number + 1));
        }
        while let Some(first) = rest.trim_start().chars().next() {
            rest = rest.trim_start();
            let length = |of: fn(char) -> bool| rest.find(|c| !of(c)).unwrap_or(rest.len());
            let (token, length) = if first.is_ascii_alphabetic() || first == '_' {
                let length = length(|c| c.is_ascii_alphanumeric() || c == '_');
                (Token::Word(rest[..length].to_owned()), length)
            } else if first.is_ascii_digit() {
                let length = length(|c| c.is_ascii_digit());
                let number = rest[..length].parse().expect("a number of a few digits");
                (Token::Number(number), length)
            } else if first == '>' && !rest.starts_with(">=") {
                (Token::Sign(">"), 1)
            } else {
                let sign = SIGNS.iter().find(|sign| rest.starts_with(**sign));
                let sign = sign.unwrap_or_else(|| panic!("line {}: {rest}", number + 1));
                (Token::Sign(sign), sign.len())
            };
            found.push((token, number + 1));
            rest = &rest[length..];
        }
    }
    found.push((Token::End, text.lines().count()));
    found
}
