//! The whole of a recording, coarsely.

use luna_logger::format::Values;
use serde_json::{Value, json};

/// The most spans; their length doubles when there are more.
const SPANS: u64 = 512;
/// The first length of a span, in nanoseconds. The page has the same.
const FIRST: u64 = 10_000_000;

/// The least and greatest value of each element of a signal in each span since the recording began.
#[derive(Debug)]
pub(super) struct Overview {
    span: u64,
    /// Of each element: of each span.
    elements: Vec<Vec<[f32; 2]>>,
}

const NONE: [f32; 2] = [f32::NAN; 2];

fn both([low, high]: [f32; 2], other: [f32; 2]) -> [f32; 2] {
    // A NaN is no value.
    [low.min(other[0]), high.max(other[1])]
}

impl Overview {
    pub(super) fn new(elements: usize) -> Self {
        Self {
            span: FIRST,
            elements: vec![Vec::new(); elements],
        }
    }

    /// A sample so many nanoseconds after the start.
    pub(super) fn put(&mut self, after: u64, values: Values<'_>) {
        while after / self.span >= SPANS {
            self.span *= 2;
            for spans in &mut self.elements {
                let pairs = spans.chunks(2);
                *spans = pairs
                    .map(|pair| both(pair[0], *pair.last().unwrap_or(&NONE)))
                    .collect();
            }
        }
        let at = (after / self.span) as usize;
        for (spans, value) in self.elements.iter_mut().zip(values.iter()) {
            if spans.len() <= at {
                spans.resize(at + 1, NONE);
            }
            let value = value.as_f64() as f32;
            spans[at] = both(spans[at], [value; 2]);
        }
    }

    /// For viewers.
    pub(super) fn json(&self, signal: u32) -> Value {
        json!({"type": "overview", "signal": signal, "span": self.span, "elements": self.elements})
    }
}
