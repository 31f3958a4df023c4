//! The pages of documentation: what they show is there.

use std::path::{Path, PathBuf};

/// The pages under `folder`.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            pages(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

#[test]
fn images_that_pages_show_are_there() {
    let mut found = Vec::new();
    pages(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("docs"),
        &mut found,
    );
    let mut images = 0;
    for page in found {
        let text = std::fs::read_to_string(&page).unwrap();
        for shown in text.split("![").skip(1) {
            let Some((_, rest)) = shown.split_once("](") else {
                continue;
            };
            let Some((image, _)) = rest.split_once(')') else {
                continue;
            };
            if !image.contains("://") {
                let path = page.parent().unwrap().join(image);
                assert!(path.is_file(), "{} shows {image}", page.display());
                images += 1;
            }
        }
    }
    assert!(images > 0, "the page of benchmarks has some");
}
