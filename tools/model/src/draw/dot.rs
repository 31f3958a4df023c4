//! DOT, for Graphviz.

use super::picture::{Text, written};
use crate::network::Network;

pub(crate) fn dot(network: &Network) -> String {
    let title = quoted(&network.name);
    let head = format!("digraph {title} {{\n  node [shape=box, style=rounded];\n");
    let text = Text {
        quoted,
        process: |number, label| format!("p{number} [label={label}];"),
        group: |number, label, indent| {
            format!("subgraph cluster{number} {{\n{indent}  label={label};")
        },
        end: "}",
        arrow: |from, to, label| format!("p{from} -> p{to} [label={label}];"),
    };
    head + &written(network, &text) + "}\n"
}

fn quoted(text: &str) -> String {
    let text = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", text.replace('\n', "\\n"))
}
