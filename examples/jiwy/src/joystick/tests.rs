//! Good and bad recordings, and playing them.

use super::*;

fn parse(text: &str) -> Result<Recording, Error> {
    Recording::parse(text.as_bytes())
}

fn fault(text: &str) -> (u64, Fault) {
    match parse(text) {
        Err(Error::Line { line, fault }) => (line, fault),
        other => panic!("{other:?}"),
    }
}

fn ramp() -> Playback {
    parse("time,pan,tilt\n10,0,0\n11,1,-0.5\n12,0,0\n")
        .unwrap()
        .play()
}

#[test]
fn names_line_and_fault() {
    let not_a_number = |column, field: &str| Fault::NotANumber {
        column,
        field: field.into(),
    };
    for (rows, line, expected) in [
        ("0,0,0\n1,left,0\n", 3, not_a_number("pan", "left")),
        ("0,0,0\n1,,0\n", 3, not_a_number("pan", "")),
        ("0,0,0\n\n\n1,0,x\n", 5, not_a_number("tilt", "x")),
        ("0,0,0\r\n1,0,0\r\n2,0,x\r\n", 4, not_a_number("tilt", "x")),
        ("0,0,0\n1,0\n", 3, Fault::MissingColumn("tilt")),
        (
            "0,0,0\n0,0,0\n",
            3,
            Fault::NotIncreasing {
                time: 0.0,
                before: 0.0,
            },
        ),
        (
            "1,0,0\n2,0,0\n1.5,0,0",
            4,
            Fault::NotIncreasing {
                time: 1.5,
                before: 2.0,
            },
        ),
        (
            "0,1.01,0\n",
            2,
            Fault::OutOfRange {
                column: "pan",
                value: 1.01,
            },
        ),
        (
            "0,0,-2\n",
            2,
            Fault::OutOfRange {
                column: "tilt",
                value: -2.0,
            },
        ),
        ("0,NaN,0\n", 2, Fault::NotFinite { column: "pan" }),
        ("inf,0,0\n", 2, Fault::NotFinite { column: "time" }),
    ] {
        assert_eq!(
            fault(&format!("time,pan,tilt\n{rows}")),
            (line, expected),
            "{rows:?}"
        );
    }
}

#[test]
fn missing_column_in_the_header() {
    assert_eq!(fault("time,pan\n0,0\n"), (1, Fault::MissingColumn("tilt")));
    assert_eq!(fault("0,0,0\n1,0,0\n"), (1, Fault::MissingColumn("time")));
}

#[test]
fn empty() {
    for text in ["", "\n\n", "time,pan,tilt", "time,pan,tilt\n\n"] {
        assert!(matches!(parse(text), Err(Error::NoSamples)), "{text:?}");
    }
}

#[test]
fn bytes_that_are_no_text() {
    let error = Recording::parse(b"time,pan,tilt\n0,\xff,0\n").unwrap_err();
    assert!(error.to_string().starts_with("line 2: "), "{error}");
}

#[test]
fn no_such_file() {
    let error = Recording::read(Path::new("/no/such/recording.csv")).unwrap_err();
    assert!(matches!(error, Error::File(_)));
}

#[test]
fn columns_in_any_order_with_spaces_and_others() {
    let recording = parse("\u{feff}button, tilt ,pan,time\n1, 0.25,-0.5, 3\n").unwrap();
    let deflection = Deflection {
        pan: -0.5,
        tilt: 0.25,
    };
    assert_eq!(recording.play().at(0.0), deflection);
    let quoted = parse("\"time\",\"pan\",\"tilt\"\n\"1\",\"-0.5\",\"0.25\"\n").unwrap();
    assert_eq!(quoted.play().at(0.0), deflection);
}

#[test]
fn interpolates() {
    let mut playback = ramp();
    for (time, pan) in [
        (0.0, 0.0),
        (0.25, 0.25),
        (1.0, 1.0),
        (1.75, 0.25),
        (1.999, 0.001),
    ] {
        let deflection = playback.at(time);
        assert!(
            (deflection.pan - pan).abs() < 1e-9,
            "{deflection:?} at {time}"
        );
        assert!(
            (deflection.tilt + pan / 2.0).abs() < 1e-9,
            "{deflection:?} at {time}"
        );
    }
}

#[test]
fn repeats_after_the_end() {
    let mut playback = ramp();
    for repetition in [0.0, 1.0, 2.0, 17.0] {
        assert!((playback.at(2.0 * repetition + 0.5).pan - 0.5).abs() < 1e-9);
        assert!((playback.at(2.0 * repetition + 1.25).pan - 0.75).abs() < 1e-9);
    }
}

#[test]
fn backwards_and_odd_times_do_no_harm() {
    let mut playback = ramp();
    playback.at(1.9);
    assert!((playback.at(0.5).pan - 0.5).abs() < 1e-9);
    playback.at(100.5);
    assert_eq!(playback.at(3.0).pan, 0.0);
    assert_eq!(playback.at(f64::NAN).pan, 0.0);
}

#[test]
fn single_sample_lasts() {
    let mut playback = parse("time,pan,tilt\n5,0.5,0\n").unwrap().play();
    assert_eq!(playback.at(0.0).pan, 0.5);
    assert_eq!(playback.at(1e6).pan, 0.5);
}

#[test]
fn default_recording_is_as_its_readme_says() {
    let recording = Recording::built_in();
    assert!(recording.length() >= 20.0, "{} s", recording.length());
    assert!(
        recording
            .samples
            .windows(2)
            .all(|pair| (pair[1].time - pair[0].time - 0.01).abs() < 1e-6)
    );
    // The hold of the thesis' figure H.6, 14 to 18 s: away from the origin, and noisy.
    let hold: Vec<f64> = recording
        .samples
        .iter()
        .filter(|s| (14.5..17.5).contains(&s.time))
        .map(|s| s.deflection.pan)
        .collect();
    let mean = hold.iter().sum::<f64>() / hold.len() as f64;
    let deviation =
        (hold.iter().map(|pan| (pan - mean).powi(2)).sum::<f64>() / hold.len() as f64).sqrt();
    assert!(
        mean.abs() > 0.2 && (0.005..0.1).contains(&deviation),
        "{mean} ± {deviation}"
    );
}
