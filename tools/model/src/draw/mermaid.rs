//! Mermaid's flowcharts, which many viewers of Markdown draw.

use super::picture::{Text, written};
use crate::network::Network;

pub(crate) fn mermaid(network: &Network) -> String {
    let text = Text {
        quoted,
        process: |number, label| format!("p{number}[{label}]"),
        group: |number, label, _| format!("subgraph g{number} [{label}]"),
        end: "end",
        arrow: |from, to, label| format!("p{from} -- {label} --> p{to}"),
    };
    "flowchart LR\n".to_owned() + &written(network, &text)
}

/// Mermaid writes special characters as `#` and their code.
fn quoted(text: &str) -> String {
    let mut quoted = "\"".to_owned();
    for letter in text.chars() {
        match letter {
            '\n' => quoted.push_str("<br>"),
            '"' | '#' | '<' | '>' | '&' => quoted.push_str(&format!("#{};", letter as u32)),
            _ => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}
