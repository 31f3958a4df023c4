//! CSV: a row for each instant or cycle, and what is selected.

use super::*;

#[test]
fn csv_has_a_row_for_each_instant() {
    let (folder, file) = recording("csv");
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(
        said.contains("6 samples of 3 signals, 2 messages"),
        "{said}"
    );
    assert!(said.contains("5 samples and messages were lost"), "{said}");
    let head = "time [s],arm/force [N],arm/place[0],arm/place[1],\"arm/\"\"ok\"\", or so\"\n";
    let rows = "0.000000000,0.1,,,\n\
                0.001000000,,1,-2,1\n\
                0.002000000,-0.00000025,,,\n\
                0.003000000,NaN,,,\n\
                0.003000000,4,,,\n";
    assert_eq!(
        fs::read_to_string(folder.join("run.csv")).unwrap(),
        format!("{head}{rows}")
    );
    let messages = fs::read_to_string(folder.join("run.messages.csv")).unwrap();
    let expected = "time [s],level,thread,process,target,text\n\
                    0.001500000,WARN,console,process 7,arm,\"too \"\"hot\"\", stop\"\n\
                    0.004000000,INFO,console,process 7,arm,\"two\nlines\"\n";
    assert_eq!(messages, expected);

    let held = folder.join("held.csv");
    let output = luna(&[
        "convert",
        path(&file),
        "--to",
        "csv",
        "--hold",
        "-o",
        path(&held),
    ]);
    assert_eq!(output.status.code(), Some(0));
    let rows = "0.000000000,0.1,,,\n\
                0.001000000,0.1,1,-2,1\n\
                0.002000000,-0.00000025,1,-2,1\n\
                0.003000000,4,1,-2,1\n";
    assert_eq!(fs::read_to_string(held).unwrap(), format!("{head}{rows}"));
}

/// Converts a recording of events, and a signal of 1 kHz beside them: what is on standard output,
/// and the table.
fn selected(test: &str, options: &[&str]) -> (String, PathBuf) {
    let (folder, file) = recording_of_events(test);
    let base = ["convert", path(&file), "--to", "csv"];
    let output = luna(&[&base, options].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    (text(&output.stdout).to_owned(), folder)
}

#[test]
fn what_is_not_selected_is_left_out() {
    for (options, count) in [
        (&[][..], 23),
        (&["--events", "none"], 0),
        (&["--events", "running,sub*done"], 6),
        (&["--process", "source"], 13),
        (&["--process", "s*"], 18),
        (&["--from", "0.00000002", "--until", "3e-8"], 7),
        (
            &["--events", "slot", "--process", "source", "--from", "0"],
            1,
        ),
    ] {
        let (said, folder) = selected("selected", options);
        let events = match count {
            0 => String::new(),
            1 => ", 1 event".to_owned(),
            count => format!(", {count} events"),
        };
        let head = format!("0 samples of 0 signals, 0 messages{events}\n");
        assert!(said.contains(&head), "{options:?}: {said}");
        let rows = fs::read_to_string(folder.join("run.events.csv"));
        assert_eq!(rows.map_or(1, |rows| rows.lines().count()), count + 1);
    }
    let (folder, file) = recording("selected-signals");
    let base = ["convert", path(&file), "--to", "csv"];
    let only = [
        "--signals",
        "arm/f*",
        "--until",
        "0.003",
        "--process",
        "none",
    ];
    let output = luna(&[&base[..], &only].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let rows = "time [s],arm/force [N]\n0.000000000,0.1\n0.002000000,-0.00000025\n";
    assert_eq!(fs::read_to_string(folder.join("run.csv")).unwrap(), rows);
    assert!(!folder.join("run.messages.csv").exists());
    for (option, name, there) in [
        (
            "--signals",
            "arm/x*",
            "there are arm/\"ok\", or so, arm/force, arm/place",
        ),
        ("--process", "gone", "none at all"),
        ("--per-cycle", "control", "no loop `control`"),
    ] {
        let output = luna(&[&base[..], &[option, name]].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(
            text(&output.stderr).contains(there),
            "{}",
            text(&output.stderr)
        );
    }
}

/// Two signals of one loop, sampled at instants of their own, and one that is slower.
#[test]
fn a_row_is_a_cycle_where_loops_were_recorded() {
    use luna_events::code;
    let (folder, file) = recording("per-cycle");
    let mut writer = Writer::new(Vec::new()).unwrap();
    for (number, name) in [(0, "error"), (1, "output"), (2, "slow")] {
        let info = SignalInfo {
            number,
            element_type: Type::F64,
            elements: 1,
            name,
            unit: "",
            description: "",
        };
        writer.put(&Record::Signal(info)).unwrap();
    }
    let a_loop = |number, name| Record::Name {
        subject: Subject::Loop,
        number,
        parent: 7,
        name,
        runs_on: None,
    };
    writer.put(&a_loop(1, "control")).unwrap();
    writer.put(&a_loop(2, "control too")).unwrap();
    let sample = |signal, time, value: f64| (time, signal, value.to_le_bytes());
    for (time, signal, bytes) in [
        sample(0, 5, 9.0),
        sample(0, 1010, 1.0),
        sample(1, 1020, 2.0),
        sample(2, 1030, 3.0),
        sample(1, 1040, 2.5),
        sample(0, 2010, 4.0),
        sample(1, 2020, 5.0),
    ] {
        let values = Values::from_bytes(Type::F64, &bytes);
        writer
            .put(&Record::Sample {
                signal,
                time,
                values,
            })
            .unwrap();
    }
    // Threads are merged round by round: these come late.
    for (time, subject) in [(1000, 1), (1035, 2), (2000, 1), (3000, 1)] {
        let event = Event {
            thread: 0,
            time,
            code: code::SLOT,
            subject,
            arguments: [0, 0],
        };
        writer.put(&Record::Event(event)).unwrap();
    }
    fs::write(&file, writer.finish().unwrap()).unwrap();
    let convert = |more: &[&str]| {
        let base = ["convert", path(&file), "--to", "csv"];
        let output = luna(&[&base, more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let table = fs::read_to_string(folder.join("run.csv")).unwrap();
        (table, text(&output.stdout).to_owned())
    };
    let table = |more: &[&str]| convert(&[&["--per-cycle", "control"], more].concat()).0;
    let rows = "time [s],error,output,slow\n\
                0.000000995,1,2.5,3\n\
                0.000001995,4,5,\n\
                0.000002995,,,\n";
    assert_eq!(table(&[]), rows);
    assert_eq!(
        fs::read_to_string(folder.join("run.events.csv"))
            .unwrap()
            .lines()
            .count(),
        5
    );
    // Without a word the loop with the most cycles gives the rows, of those in which something was
    // sampled.
    let (by_default, said) = convert(&[]);
    assert_eq!(by_default + "0.000002995,,,\n", rows);
    assert!(
        said.contains("a row is a cycle of control; --per-sample"),
        "{said}"
    );
    // One came before the first cycle, and one had a later one in its own.
    assert!(said.contains("2 samples not in the rows"), "{said}");
    let (samples, said) = convert(&["--per-sample"]);
    assert_eq!(samples.lines().count(), 1 + 7, "{samples}");
    assert!(!said.contains("cycle"), "{said}");
    // Cycles are rows also where their events are left out.
    let held = rows.replace("5,\n", "5,3\n").replace(",,,\n", ",4,5,3\n");
    fs::remove_file(folder.join("run.events.csv")).unwrap();
    assert_eq!(table(&["--hold", "--events", "none"]), held);
    assert!(!folder.join("run.events.csv").exists());
}
