//! Numbers that are not finite, and integers that no `f64` holds: each format keeps them apart.

#[cfg(feature = "mcap")]
use super::samples::sample;
use super::*;

const FLOATS: [f64; 6] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    -0.0,
    1.5,
];
const LARGE: [i64; 2] = [i64::MIN + 1, (1 << 53) + 1];

/// Each number at an instant of its own: alone, and as an element of a vector of `f32`.
fn recorded(test: &str) -> (PathBuf, PathBuf) {
    let (folder, file) = recording(test);
    let mut writer = Writer::new(Vec::new()).unwrap();
    let session = Record::Session {
        system: "test",
        clock: ClockBase::Monotonic,
        written_by: "a test",
    };
    writer.put(&session).unwrap();
    for (number, element_type, elements, name) in [
        (0, Type::F64, 1, "force"),
        (1, Type::F32, 2, "pair"),
        (2, Type::I64, 1, "count"),
    ] {
        let info = SignalInfo {
            number,
            element_type,
            elements,
            name,
            unit: "",
            description: "",
        };
        writer.put(&Record::Signal(info)).unwrap();
    }
    let mut put = |signal, time, of, bytes: &[u8]| {
        let values = Values::from_bytes(of, bytes);
        let sample = Record::Sample {
            signal,
            time,
            values,
        };
        writer.put(&sample).unwrap();
    };
    for (time, value) in (0_u64..).zip(FLOATS) {
        put(0, time, Type::F64, &value.to_le_bytes());
        let pair = [value as f32, 0.25].map(f32::to_le_bytes).concat();
        put(1, time, Type::F32, &pair);
    }
    for (time, value) in (0_u64..).zip(LARGE) {
        put(2, time, Type::I64, &value.to_le_bytes());
    }
    fs::write(&file, writer.finish().unwrap()).unwrap();
    (folder, file)
}

fn convert(file: &Path, to: &str) {
    let output = luna(&["convert", path(file), "--to", to]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn csv_keeps_numbers_that_are_not_finite_apart() {
    let (folder, file) = recorded("not-finite-csv");
    convert(&file, "csv");
    let table = fs::read_to_string(folder.join("run.csv")).unwrap();
    let cells: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|row| {
            let cells = row.split(',').skip(1).take(2);
            cells.map(|cell| cell.parse().unwrap()).collect()
        })
        .collect();
    let bits = |value: f64| value.to_bits();
    for (row, value) in cells.iter().zip(FLOATS) {
        assert_eq!(bits(row[0]), bits(value), "{table}");
        assert_eq!(bits(row[1]), bits((value as f32).into()), "{table}");
    }
    assert_eq!(cells.len(), FLOATS.len());
    assert!(
        table.contains(",inf,inf,") && table.contains(",-inf,-inf,"),
        "{table}"
    );
    assert!(table.contains(&LARGE[0].to_string()), "{table}");
}

/// Against the file's own schemas.
#[cfg(feature = "mcap")]
#[test]
fn mcap_keeps_numbers_that_are_not_finite_apart() {
    let (folder, file) = recorded("not-finite-mcap");
    convert(&file, "mcap");
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    let (mut forces, mut pairs, mut counts) = (Vec::new(), Vec::new(), Vec::new());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        match &*message.channel.topic {
            "/force" => forces.push(sample(&message).double()),
            "/pair" => pairs.push(sample(&message).floats()),
            "/count" => counts.push(sample(&message).signed()),
            other => panic!("topic {other}"),
        }
    }
    let bits = |value: f64| value.to_bits();
    assert_eq!(
        forces.into_iter().map(bits).collect::<Vec<_>>(),
        FLOATS.map(bits)
    );
    let first = pairs.iter().map(|pair| pair[0].to_bits());
    let expected = FLOATS.map(|value| (value as f32).to_bits());
    assert_eq!(first.collect::<Vec<_>>(), expected);
    assert!(pairs.iter().all(|pair| pair[1..] == [0.25]));
    assert_eq!(counts, LARGE);
    let Some(read) = read_mcap(&folder.join("run.mcap")) else {
        return;
    };
    let expected = "/force luna.f64x1 nan\n\
                    /pair luna.f32x2 [nan, 0.25]\n\
                    /force luna.f64x1 inf\n\
                    /pair luna.f32x2 [inf, 0.25]\n\
                    /force luna.f64x1 -inf\n\
                    /pair luna.f32x2 [-inf, 0.25]\n\
                    /force luna.f64x1 1.7976931348623157e+308\n\
                    /pair luna.f32x2 [inf, 0.25]\n\
                    /force luna.f64x1 -0.0\n\
                    /pair luna.f32x2 [-0.0, 0.25]\n\
                    /force luna.f64x1 1.5\n\
                    /pair luna.f32x2 [1.5, 0.25]\n\
                    /count luna.i64x1 -9223372036854775807\n\
                    /count luna.i64x1 9007199254740993\n";
    assert_eq!(read, expected);
}

#[test]
fn perfetto_keeps_numbers_that_are_not_finite_apart() {
    let (folder, file) = recorded("not-finite-perfetto");
    convert(&file, "perfetto");
    let Some(read) = read_trace(&folder.join("run.perfetto-trace")) else {
        return;
    };
    let force = "counter force []: 0=nan 1=inf 2=-inf 3=1.7976931348623157e+308 4=-0.0 5=1.5\n";
    let pair = "counter pair[0] []: 0=nan 1=inf 2=-inf 3=inf 4=-0.0 5=1.5\n";
    assert!(read.contains(force), "{read}");
    assert!(read.contains(pair), "{read}");
}
