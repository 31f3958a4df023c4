//! Parameters in the page.

use super::{LAPTOP, browser, is_content, settings};
use luna_scope::{Parameter, Parameters, Scope};
use serde_json::Value;
use std::sync::{Arc, Mutex};

struct Gain(Mutex<f64>);

impl Parameters for Gain {
    fn list(&self) -> Vec<Parameter> {
        let gain = *self.0.lock().unwrap();
        vec![
            Parameter::new("pan/gain", gain)
                .unit("V/rad")
                .range(0.0, 50.0),
        ]
    }

    fn set(&self, _: &str, value: &Value) -> Result<(), String> {
        *self.0.lock().unwrap() = value.as_f64().ok_or("it is a number")?;
        Ok(())
    }
}

#[test]
fn parameters_can_be_set_with_the_token_and_only_looked_at_without() {
    let Some(browser) = browser("parameters") else {
        return;
    };
    let gain = Arc::new(Gain(Mutex::new(8.0)));
    let settings = settings().parameters(gain.clone()).allow_setting().unwrap();
    let scope = Scope::open(settings).unwrap();
    let url = scope.url();
    browser.open(url.split('#').next().unwrap(), LAPTOP, "light");
    browser.wait("!document.querySelector('#tab-parameters').hidden");
    browser.click("#tab-parameters");
    browser.wait("document.querySelector('.parameter input')?.value === '8'");
    assert_eq!(
        browser.run("document.querySelector('.parameter input').disabled"),
        true
    );

    browser.navigate("about:blank");
    browser.open(&url, LAPTOP, "light");
    browser.wait("document.querySelector('.parameter input')?.disabled === false");
    browser.run("(() => { const i = document.querySelector('.parameter input'); i.value = 12.5; i.form.requestSubmit(); })()");
    browser.wait("scope.connection.sets.size === 0");
    browser.wait("document.querySelector('.parameter .error').textContent === ''");
    let set = *gain.0.lock().unwrap();
    assert_eq!(set, 12.5);
    is_content(&browser);
}
