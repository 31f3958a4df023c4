//! Events, in each format.

use super::*;

#[test]
fn events_are_rows_in_words() {
    let (folder, file) = recording_of_events("events-csv");
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains("0 messages, 23 events"), "{said}");
    assert!(said.contains("4 events were lost"), "{said}");
    let rows = fs::read_to_string(folder.join("run.events.csv")).unwrap();
    let expected = "time [s],event,thread,subject,first,second\n\
                    0.000000000,executor asleep,thread of main,main,,\n\
                    0.000000010,executor awake,thread of main,main,,\n\
                    0.000000011,ready,thread of main,source,,\n\
                    0.000000012,running,thread of main,\"sink, or so\",,\n\
                    0.000000020,waiting,thread of main,\"sink, or so\",force,\n\
                    0.000000021,running,thread of main,source,,\n\
                    0.000000022,sub-process running,thread of main,left,source,\n\
                    0.000000022,sub-process running,thread of main,inner,source,left\n\
                    0.000000023,sub-process waiting,thread of main,inner,force,\n\
                    0.000000024,sub-process waiting,thread of main,left,,\n\
                    0.000000025,slot,thread of main,control,41,250\n\
                    0.000000030,communication,thread of main,force,source,\"sink, or so\"\n\
                    0.000000031,ready,thread of main,\"sink, or so\",source,\n\
                    0.000000032,sub-process done,thread of main,inner,dropped,\n\
                    0.000000033,sub-process done,thread of main,left,returned,\n\
                    0.000000034,sub-process running,thread of main,left,source,\n\
                    0.000000035,sub-process done,thread of main,left,returned,\n\
                    0.000000036,sub-process waiting,thread of main,sub-process 99,,\n\
                    0.000000040,waiting,thread of main,source,still ready,\n\
                    0.000000041,running,thread of main,\"sink, or so\",,\n\
                    0.000000050,done,thread of main,\"sink, or so\",error,\n\
                    0.000000055,stolen,thread of main,core 1,20,40\n\
                    0.000000060,event 999,thread of main,5,1,2\n";
    assert_eq!(rows, expected);
}

#[cfg(feature = "mcap")]
#[test]
fn events_are_a_topic() {
    let (folder, file) = recording_of_events("events-mcap");
    let output = luna(&["convert", path(&file), "--to", "mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    let mut events = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic == "/luna/events" {
            let content: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            let schema = message.channel.schema.clone().unwrap();
            let described: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
            let fields = content.as_object().unwrap().keys();
            assert!(fields.clone().count() == 8);
            for name in fields {
                assert!(described["properties"].get(name).is_some(), "{name}");
            }
            events.push((message.log_time - UNIX as u64, content));
        }
    }
    assert_eq!(events.len(), 23);
    let (after, communication) = &events[11];
    assert_eq!(*after, 30);
    assert_eq!(communication["event"], "communication");
    assert_eq!(communication["subject"], "force");
    assert_eq!(communication["first"], "source");
    assert_eq!(communication["second"], "sink, or so");
    assert_eq!(communication["arguments"], serde_json::json!([7, 8]));
    assert_eq!(communication["thread"], "thread of main");
}

#[test]
fn events_are_tracks_by_the_schema_of_perfetto() {
    let (folder, file) = recording_of_events("events-perfetto");
    let output = luna(&["convert", path(&file), "--to", "perfetto"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let trace = folder.join("run.perfetto-trace");
    assert!(fs::metadata(&trace).unwrap().len() > 200);
    let Some(reported) = read_trace(&trace) else {
        return;
    };
    let expected = "process 1 test\n\
                    wall 1700000000000000000\n\
                    thread thread of main\n\
                    track executor main\n\
                    track source\n\
                    track sink, or so\n\
                    track left\n\
                    track inner\n\
                    slice left 22-24 running\n\
                    slice inner 22-23 running\n\
                    slice inner 23-32 waiting for force\n\
                    slice left 24-33 waiting\n\
                    slice left 34-35 running\n\
                    slice executor main 0-10 asleep\n\
                    slice executor main 12-20 sink, or so\n\
                    slice sink, or so 12-20 running\n\
                    slice source 11-21 ready\n\
                    slice sink, or so 20-31 waiting for force\n\
                    slice source 21-40 running\n\
                    slice executor main 21-40 source\n\
                    slice sink, or so 31-41 ready\n\
                    slice sink, or so 41-50 running\n\
                    slice executor main 41-50 sink, or so\n\
                    flow source send force -> sink, or so receive force\n\
                    instant source  25 slot control (first=41, second=250)\n\
                    instant source  30 send force ()\n\
                    instant sink, or so  30 receive force ()\n\
                    instant sink, or so  50 done: error ()\n\
                    instant thread of main  55 stolen core 1 (first=20, second=40)\n\
                    instant thread of main  60 event 999 5 (first=1, second=2)\n";
    let sorted = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    assert_eq!(sorted(&reported), sorted(expected));
}
