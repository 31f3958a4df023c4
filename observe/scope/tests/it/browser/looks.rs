//! What the page looks like in windows of each size, and whether it can be used without eyes or a
//! mouse.

use super::{LAPTOP, is_content, number, picture, still};
use serde_json::Value;

const TABLET: (u32, u32) = (820, 1180);
const PHONE: (u32, u32) = (400, 800);
const SIZES: [(u32, u32); 4] = [LAPTOP, TABLET, (1180, 820), PHONE];
const VIEWS: [&str; 5] = ["signals", "loops", "composition", "timeline", "messages"];

/// Texts that reach out of the window, or are cut by the element that they stand in. The graph and
/// the values scroll.
const CUT: &str = "(() => {
    const cut = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        const element = node.parentElement;
        if (!node.data.trim() || !element.checkVisibility({ checkVisibilityCSS: true }) || element.closest('#graph, #readings, option, .skip, .hidden-label, noscript')) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        const { left, right } = range.getBoundingClientRect();
        let is = left < -0.5 || right > innerWidth + 0.5;
        for (let box = element; box !== document.body; box = box.parentElement) {
            const { overflowX } = getComputedStyle(box), { left: begin, right: end } = box.getBoundingClientRect();
            if (overflowX !== 'visible' && (left < begin - 0.5 || right > end + 0.5)) is = true;
        }
        if (is) cut.push(node.data.trim());
    }
    return cut;
})()";

#[test]
fn it_fits_in_light_and_dark_on_laptop_tablet_and_phone() {
    let Some((browser, _scope)) = still("sizes") else {
        return;
    };
    for theme in ["light", "dark"] {
        for size in SIZES {
            browser.look(size, theme);
            browser.wait(&format!(
                "document.documentElement.dataset.theme === '{theme}' && innerWidth === {}",
                size.0
            ));
            for view in VIEWS {
                browser.run(&format!(
                    "scope.show('{view}'); scope.views.composition.lay({})",
                    size != PHONE
                ));
                browser.frames(3);
                let overflow = browser.run(&format!("(() => {{ const v = document.querySelector('#{view}'); return [document.documentElement.scrollWidth - innerWidth, v.scrollWidth - v.clientWidth, document.querySelector('header').scrollWidth - innerWidth, document.documentElement.scrollHeight - innerHeight]; }})()"));
                for part in overflow.as_array().unwrap() {
                    assert!(number(part) <= 0.0, "{view} {size:?}: {overflow}");
                }
                if size == PHONE {
                    let cut = browser.run(CUT);
                    assert_eq!(cut, Value::Array(Vec::new()), "{view}");
                    // The names of the lanes, which are drawn, have room too.
                    let room = "scope.views.timeline.gutter - 10 - scope.views.timeline.longest";
                    if view == "timeline" {
                        assert!(number(&browser.run(room)) >= 0.0);
                    }
                }
                picture(&browser, &format!("{view}-{}-{theme}", size.0));
            }
        }
        let contrast = browser.run("(() => { const lum = (c) => { const [r, g, b] = c.match(/\\d+/g).map((x) => { x /= 255; return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; }; const text = lum(getComputedStyle(document.querySelector('footer')).color), ground = lum(getComputedStyle(document.querySelector('footer')).backgroundColor); return (Math.max(text, ground) + 0.05) / (Math.min(text, ground) + 0.05); })()");
        assert!(number(&contrast) >= 4.5, "{theme}: {contrast}");
    }
    // The switch goes the other way, and is remembered.
    browser.click("#theme");
    browser.wait("document.documentElement.dataset.theme === 'light'");
    is_content(&browser);
}

/// By the rules of axe-core, whose file `LUNA_AXE` names. Without it the test is left out.
#[test]
fn axe_finds_nothing_serious() {
    let Some(axe) = std::env::var_os("LUNA_AXE") else {
        eprintln!("skipped: axe: LUNA_AXE does not name axe.min.js (npm: axe-core)");
        return;
    };
    let Some((browser, _scope)) = still("axe") else {
        return;
    };
    let axe = std::fs::read_to_string(axe).unwrap();
    browser.run(&format!("{axe}; 0"));
    // As much as there can be.
    browser.click("#cursors");
    browser.click("#statistics");
    browser.click("#trigger");
    browser.run("document.querySelector('#signal-list .more').click()");
    let mut found = Vec::new();
    for theme in ["light", "dark"] {
        for size in [LAPTOP, PHONE] {
            browser.look(size, theme);
            for view in VIEWS {
                browser.run(&format!("scope.show('{view}')"));
                browser.frames(3);
                let serious = browser.run("axe.run(document, { resultTypes: ['violations'] }).then(({ violations }) => violations.filter(({ impact }) => ['serious', 'critical'].includes(impact)).map(({ id, nodes }) => [id, ...nodes.slice(0, 5).map(({ html, failureSummary }) => `${html.slice(0, 200)} ${failureSummary}`)]))");
                if serious != Value::Array(Vec::new()) {
                    found.push(format!("{view} {size:?} {theme}: {serious:#}"));
                }
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
    is_content(&browser);
}
