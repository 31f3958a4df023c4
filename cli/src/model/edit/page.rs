//! The files of the page, compiled in. Its style and icon are the scope's.

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Path, kind and content.
const FILES: [(&str, &str, &[u8]); 9] = [
    ("/", HTML, include_bytes!("page/index.html")),
    ("/editor.css", CSS, include_bytes!("page/editor.css")),
    ("/main.js", SCRIPT, include_bytes!("page/main.js")),
    ("/talk.js", SCRIPT, include_bytes!("page/talk.js")),
    ("/canvas.js", SCRIPT, include_bytes!("page/canvas.js")),
    ("/wires.js", SCRIPT, include_bytes!("page/wires.js")),
    ("/ways.js", SCRIPT, include_bytes!("page/ways.js")),
    ("/panel.js", SCRIPT, include_bytes!("page/panel.js")),
    ("/findings.js", SCRIPT, include_bytes!("page/findings.js")),
];

pub(super) fn file(path: &str) -> Option<(&'static str, &'static [u8])> {
    let found = FILES.iter().find(|(known, ..)| *known == path);
    found.map(|&(_, kind, content)| (kind, content))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All imports exist, and nothing is loaded from elsewhere.
    #[test]
    fn the_page_is_whole() {
        for (path, _, content) in FILES {
            let text = std::str::from_utf8(content).unwrap();
            for quoted in text.split('"').filter(|text| text.starts_with("./")) {
                assert!(file(&quoted[1..]).is_some(), "{path}: {quoted}");
            }
            let text = text.replace("http://www.w3.org/2000/svg", "");
            for foreign in ["https://", "http://", "src=\"//", "@import"] {
                assert!(!text.contains(foreign), "{path}: {foreign}");
            }
        }
    }
}
