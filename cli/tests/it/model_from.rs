//! `luna model from`: its model accepts the recording that it is from.

use crate::model_trace::{Run, commstime, traced};
use crate::run::{file, luna_model, path, text};
use luna::log::Logging;
use luna::prelude::*;
use std::fs;
use std::path::Path;

/// A system with what commstime lacks: a buffer, an array of channels, a loop, an alternative, and a
/// branch that sends to another one of its process.
fn workshop(file: &Path, on_threads: bool) -> luna::Result<()> {
    let mut system = System::new("workshop");
    system.log(Logging::to_file(file).replacing().room_for_events(1 << 18));
    let first = system.executor("first").build()?;
    let second = match on_threads {
        true => system.executor("second").build()?,
        false => first.clone(),
    };
    let (mut benches, mut parts) = (Vec::new(), Vec::new());
    for number in 0..2 {
        let (give, take) = luna::channel::<u32>();
        let give = give.named(&format!("bench[{number}]"));
        benches.push(take);
        let (put, store) = luna::buffered::<u32>(luna::Buffer::fifo(3));
        parts.push(put.named(&format!("parts[{number}]")));
        let executor = if number == 0 { &first } else { &second };
        executor
            .process(format!("worker[{number}]"))
            .priority(number + 3)
            .spawn(async move {
                while let Ok(part) = store.recv().await {
                    give.send(part).await?;
                }
                Ok(())
            })?;
    }
    second.process("supply").spawn(async move {
        for part in 0..50 {
            for to in &parts {
                to.send(part).await?;
            }
        }
        Ok(())
    })?;
    let [one, other] = <[_; 2]>::try_from(benches).expect("there are two");
    first.process("packer").spawn(async move {
        let (put, packed) = luna::channel::<u32>();
        let put = put.named("packed");
        let collect = async {
            for _ in 0..100 {
                let part = luna::alt! {
                    part = one.recv() => part,
                    part = other.recv() => part,
                };
                match part {
                    Ok(part) => put.send(part).await?,
                    Err(_) => break,
                }
            }
            drop(put);
            Ok::<(), luna::Error>(())
        };
        let count = async {
            while packed.recv().await.is_ok() {}
            Ok::<(), luna::Error>(())
        };
        let _ = luna::par!(collect, count).await;
        Ok(())
    })?;
    let _ = system.run();
    Ok(())
}

#[test]
fn a_model_of_a_recording_accepts_it() {
    let record = |name: &str, make: &dyn Fn(&Path) -> luna::Result<()>| {
        let recording = file(&format!("{name}.luna"));
        make(&recording).expect("it runs");
        let model = file(&format!("{name}.toml"));
        let output = luna_model(&["from", path(&recording), "-o", path(&model)]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let made = fs::read_to_string(&model).unwrap();
        let (code, said) = traced(path(&model), &recording, &[]);
        assert_eq!(code, Some(0), "{name}: {said}\n{made}");
        assert!(said.starts_with("trace accepted: "), "{name}: {said}");
        // It is not written over: it may have been refined.
        let again = luna_model(&["from", path(&recording), "-o", path(&model)]);
        assert_eq!(again.status.code(), Some(2));
        made
    };
    let threads = Run {
        on_threads: true,
        ..Run::default()
    };
    record("from-commstime", &|file| commstime(file, 200, threads));
    for on_threads in [false, true] {
        let name = format!("from-workshop-{on_threads}");
        let made = record(&name, &|file| workshop(file, on_threads));
        for part in [
            "name = \"workshop\"",
            "[system.channel.parts_1]\nbuffer = \"fifo ",
            "[system.channel.bench_1]\n",
            "[system.part.worker_0]\nprocess = \"worker_0\"\nbind = { parts_0 = \"parts_0\", bench_0 = \"bench_0\" }\npriority = 3\non = \"first\"",
            "ports = { parts_0 = \"receive\", bench_0 = \"send\" }\nbody = \"loop { alt { parts_0? | bench_0! } }\"",
            "body = \"par { loop { alt { bench_0? | bench_1? | packed_out! } } | loop { packed? } }\"",
            "[executor.first]",
        ] {
            assert!(made.contains(part), "{part}: {made}");
        }
    }
}
