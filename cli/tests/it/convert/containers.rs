//! MCAP and Perfetto traces, read by the readers of their formats.

#[cfg(feature = "mcap")]
use super::samples::sample;
use super::*;

/// The content of a message in JSON, all of whose fields its schema has.
#[cfg(feature = "mcap")]
fn described(message: &mcap::Message<'_>) -> serde_json::Value {
    let content: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
    assert_eq!(message.channel.message_encoding, "json");
    let schema = message.channel.schema.clone().unwrap();
    assert_eq!(schema.encoding, "jsonschema");
    let described: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
    assert_eq!(described["type"], "object");
    for name in content.as_object().unwrap().keys() {
        let property = described["properties"].get(name);
        assert!(property.is_some(), "{name} in {described}");
    }
    content
}

#[cfg(feature = "mcap")]
#[test]
fn mcap_is_read_by_the_readers_of_its_format() {
    let (folder, file) = recording("mcap");
    let output = luna(&["convert", path(&file), "--to", "mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    let mut messages = Vec::new();
    let (mut forces, mut places, mut truths) = (Vec::new(), Vec::new(), Vec::new());
    // With the checksums of all sections.
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let after = message.log_time - UNIX as u64;
        match &*message.channel.topic {
            "/arm/force" => forces.push((after, sample(&message).double().to_string())),
            "/arm/place" => places.push((after, sample(&message).small())),
            "/arm/\"ok\", or so" => truths.push((after, sample(&message).truth())),
            topic => messages.push((topic.to_owned(), described(&message))),
        }
    }
    let expected = [
        (0, "0.1"),
        (2_000_000, "-0.00000025"),
        (3_000_000, "NaN"),
        (3_000_000, "4"),
    ];
    assert_eq!(
        forces,
        expected.map(|(after, value)| (after, value.to_owned()))
    );
    assert_eq!(places, [(1_000_000, vec![1, -2])]);
    assert_eq!(truths, [(1_000_000, true)]);
    let log: Vec<_> = messages
        .iter()
        .filter(|message| message.0 == "/luna/log")
        .collect();
    assert_eq!(log.len(), 2);
    assert_eq!(log[0].1["message"], "too \"hot\", stop");
    assert_eq!(
        (&log[0].1["level"], &log[0].1["name"]),
        (&3.into(), &"console: arm".into())
    );
    assert_eq!(log[0].1["timestamp"]["nsec"], 1_500_000);
    let lost = messages
        .iter()
        .rfind(|message| message.0 == "/luna/losses")
        .unwrap();
    assert_eq!(
        (&lost.1["of"], &lost.1["lost"]),
        (&"/arm/force".into(), &5.into())
    );
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert!(
        summary
            .chunk_indexes
            .iter()
            .all(|chunk| chunk.compression == "lz4")
    );
    assert_eq!(summary.stats.unwrap().message_count, 10);
    let unit = summary
        .channels
        .values()
        .find(|channel| channel.topic == "/arm/force")
        .unwrap();
    assert_eq!(unit.metadata["unit"], "N");
}

/// The Python package `perfetto` brings the trace's own schema. `.ci/run` installs it and names a
/// Python that has it.
#[test]
fn perfetto_traces_are_read_by_their_own_schema() {
    let (folder, file) = recording("perfetto");
    let output = luna(&["convert", path(&file), "--to", "perfetto"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let trace = folder.join("run.perfetto-trace");
    assert!(fs::metadata(&trace).unwrap().len() > 200);
    let Some(reported) = read_trace(&trace) else {
        return;
    };
    let expected = "process 1 test\n\
                    wall 1700000000000000000\n\
                    thread control\n\
                    thread console\n\
                    counter arm/force [N]: 0=0.1 2000000=-2.5e-07 3000000=nan 3000000=4.0\n\
                    counter arm/place[0] []: 1000000=1\n\
                    counter arm/place[1] []: 1000000=-2\n\
                    counter arm/\"ok\", or so []: 1000000=1\n\
                    instant console WARN 1500000 too \"hot\", stop (target=arm)\n\
                    instant console INFO 4000000 two lines (target=arm)\n";
    assert_eq!(reported, expected);
}
