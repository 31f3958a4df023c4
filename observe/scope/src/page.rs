//! The files of the page, compiled in, so that it works without internet.

/// A file of the page.
pub(crate) struct Asset {
    pub(crate) path: &'static str,
    pub(crate) kind: &'static str,
    pub(crate) content: &'static [u8],
}

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";

macro_rules! assets {
    ($($path:literal $kind:ident $file:literal),* $(,)?) => {
        &[$(Asset {
            path: $path,
            kind: $kind,
            content: include_bytes!(concat!("../page/", $file)),
        }),*]
    };
}

const ASSETS: &[Asset] = assets![
    "/" HTML "index.html",
    "/style.css" CSS "style.css",
    "/icon.svg" SVG "icon.svg",
    "/main.js" SCRIPT "main.js",
    "/connection.js" SCRIPT "connection.js",
    "/decode.js" SCRIPT "decode.js",
    "/model.js" SCRIPT "model.js",
    "/series.js" SCRIPT "series.js",
    "/events.js" SCRIPT "events.js",
    "/clock.js" SCRIPT "clock.js",
    "/draw.js" SCRIPT "draw.js",
    "/gestures.js" SCRIPT "gestures.js",
    "/picture.js" SCRIPT "picture.js",
    "/drawing.js" SCRIPT "drawing.js",
    "/signals.js" SCRIPT "signals.js",
    "/cursors.js" SCRIPT "cursors.js",
    "/export.js" SCRIPT "export.js",
    "/loops.js" SCRIPT "loops.js",
    "/composition.js" SCRIPT "composition.js",
    "/timeline.js" SCRIPT "timeline.js",
    "/messages.js" SCRIPT "messages.js",
    "/parameters.js" SCRIPT "parameters.js",
    "/text.js" SCRIPT "text.js",
    "/whole.js" SCRIPT "whole.js",
    "/address.js" SCRIPT "address.js",
    "/ending.js" SCRIPT "ending.js",
    "/list.js" SCRIPT "list.js",
    "/marks.js" SCRIPT "marks.js",
    "/readings.js" SCRIPT "readings.js",
    "/trigger.js" SCRIPT "trigger.js",
    "/xy.js" SCRIPT "xy.js",
    "/graph.js" SCRIPT "graph.js",
];

/// The file of a path.
pub(crate) fn asset(path: &str) -> Option<&'static Asset> {
    ASSETS.iter().find(|asset| asset.path == path)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All imports exist, and nothing is loaded from elsewhere.
    #[test]
    fn the_page_is_whole() {
        for asset in ASSETS {
            let text = std::str::from_utf8(asset.content).unwrap();
            for quoted in text.split('"').filter(|text| text.starts_with("./")) {
                let path = &quoted[1..];
                assert!(self::asset(path).is_some(), "{}: {path}", asset.path);
            }
            for foreign in ["https://", "src=\"//", "@import"] {
                assert!(!text.contains(foreign), "{}: {foreign}", asset.path);
            }
        }
    }
}
