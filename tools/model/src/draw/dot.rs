//! DOT, for Graphviz.

use super::picture::{Item, arrows, contents, details, short};
use crate::network::Network;
use std::fmt::Write;

pub(crate) fn dot(network: &Network) -> String {
    let mut text = format!(
        "digraph {} {{\n  node [shape=box, style=rounded];\n",
        quoted(&network.name)
    );
    group(network, &contents(network), 0, 1, &mut text);
    for arrow in arrows(network) {
        let (from, to) = (arrow.from, arrow.to);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  p{from} -> p{to} [label={}];", quoted(&arrow.label));
    }
    text.push_str("}\n");
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
                writeln!(text, "{indent}p{process} [label={}];", quoted(&label))
            }
            Item::Group(inner) => {
                let label = quoted(short(&network.groups[inner].name));
                let _ = writeln!(
                    text,
                    "{indent}subgraph cluster{inner} {{\n{indent}  label={label};"
                );
                group(network, contents, inner, depth + 1, text);
                writeln!(text, "{indent}}}")
            }
        };
    }
}

fn quoted(text: &str) -> String {
    let text = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", text.replace('\n', "\\n"))
}
