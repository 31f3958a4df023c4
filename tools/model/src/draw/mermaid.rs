//! Mermaid's flowcharts, which many viewers of Markdown draw.

use super::picture::{Item, arrows, contents, details, short};
use crate::network::Network;
use std::fmt::Write;

pub(crate) fn mermaid(network: &Network) -> String {
    let mut text = "flowchart LR\n".to_owned();
    group(network, &contents(network), 0, 1, &mut text);
    for arrow in arrows(network) {
        let (from, to) = (arrow.from, arrow.to);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  p{from} -- {} --> p{to}", quoted(&arrow.label));
    }
    text
}

fn group(
    network: &Network,
    contents: &[Vec<Item>],
    number: usize,
    depth: usize,
    text: &mut String,
) {
    let indent = "  ".repeat(depth);
    for item in &contents[number] {
        let _ = match *item {
            Item::Process(process) => {
                let name = short(&network.processes[process].name);
                let label = format!("{name}\n{}", details(network, process));
                writeln!(text, "{indent}p{process}[{}]", quoted(&label))
            }
            Item::Group(inner) => {
                let label = quoted(short(&network.groups[inner].name));
                let _ = writeln!(text, "{indent}subgraph g{inner} [{label}]");
                group(network, contents, inner, depth + 1, text);
                writeln!(text, "{indent}end")
            }
        };
    }
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
