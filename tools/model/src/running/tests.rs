//! Systems beside their models.

use super::*;
use luna::Buffer;
use luna::prelude::*;

const MODEL: &str = r#"
name = "pair"

[process.Producer]
ports = { to = "send" }
body = "loop { to! }"

[process.Consumer]
ports = { from = "receive" }
body = "loop { from? }"

[executor.main]
core = 0
policy = "fifo:40"

[executor.alone]
kind = "thread"

[system.channel.values]
buffer = "fifo 2"

[system.part.producer]
process = "Producer"
bind.to = "values"
priority = 3
on = "main"

[system.part.consumer]
process = "Consumer"
bind.from = "values"
on = "alone"
"#;

fn model() -> Model {
    Model::parse("pair.toml", MODEL).unwrap()
}

/// What the processes of a test send and receive on.
fn values(buffer: usize) -> (Sender<u32>, Receiver<u32>) {
    let (sender, receiver) = luna::buffered(Buffer::fifo(buffer));
    (sender.named("values"), receiver)
}

fn texts(system: &impl SystemModel) -> Vec<String> {
    match system.check_wiring(&model()) {
        Ok(()) => Vec::new(),
        Err(wiring) => wiring
            .differences
            .iter()
            .map(Difference::to_string)
            .collect(),
    }
}

async fn send(values: Sender<u32>) -> luna::Result<()> {
    Ok(values.send(1).await?)
}

async fn receive(values: Receiver<u32>) -> luna::Result<()> {
    values.recv().await?;
    Ok(())
}

#[test]
fn a_system_that_is_as_its_model_says_has_no_differences() {
    let mut system = System::new("pair");
    let main = system.executor("main").core(0).policy(Policy::fifo(40));
    let main = main.build().unwrap();
    let (sender, receiver) = values(2);
    main.process("producer")
        .priority(3)
        .spawn(send(sender))
        .unwrap();
    let alone = system.thread("alone").process("consumer");
    alone.spawn(receive(receiver)).unwrap();
    assert_eq!(texts(&system), [""; 0]);
    // Also from another representation of it.
    assert_eq!(texts(&system.composition()), [""; 0]);
}

#[test]
fn each_difference_of_the_plan_is_named() {
    let mut system = System::new("pair");
    let main = system.thread("main").process("consumer");
    main.spawn(async { Ok(()) }).unwrap();
    let other = system.executor("alone").build().unwrap();
    other.process("stranger").spawn(async { Ok(()) }).unwrap();
    assert_eq!(
        texts(&system),
        [
            "process `producer` is in the model alone",
            "process `consumer`: on main, in the model alone",
            "process `stranger` is not in the model",
            "thread `main`: a thread, in the model an executor",
            "thread `main`: core any, in the model 0",
            "thread `main`: policy other, in the model fifo:40",
            "thread `alone`: an executor, in the model a thread",
        ]
    );
}

#[test]
fn channels_are_compared_while_the_system_runs() {
    let mut system = System::new("pair");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let (sender, receiver) = values(3);
    let (other, stop) = luna::channel::<u32>();
    main.process("consumer")
        .priority(2)
        .spawn(send(sender))
        .unwrap();
    main.process("producer")
        .priority(1)
        .spawn(async move {
            receiver.recv().await?;
            let found = texts(&observer);
            for expected in [
                "channel `values`: a buffer of 3, in the model a buffer of 2",
                "channel `values`: sent to by consumer, in the model producer",
                "channel `values`: received from by producer, in the model consumer",
            ] {
                assert!(found.contains(&expected.to_owned()), "{found:#?}");
            }
            // The one without a name, by the place where it was made.
            let is_stranger = |text: &&String| {
                text.contains("running/tests.rs") && text.ends_with("` is not in the model")
            };
            assert_eq!(found.iter().filter(is_stranger).count(), 1, "{found:#?}");
            let model = Model::parse("ran.toml", &observer.model()).unwrap();
            assert_eq!(observer.check_wiring(&model), Ok(()));
            Ok(other.send(1).await?)
        })
        .unwrap();
    main.process("third")
        .priority(3)
        .spawn(receive(stop))
        .unwrap();
    system.run().unwrap();
}

/// A system with these processes of one level each, which do nothing.
fn idle(processes: &[(&str, u8)]) -> System {
    let mut system = System::new("pair");
    let main = system.executor("main").build().unwrap();
    for (name, priority) in processes {
        let process = main.process(*name).priority(*priority);
        process.spawn(async { Ok(()) }).unwrap();
    }
    system
}

#[test]
fn each_of_several_processes_of_one_name_is_compared() {
    let text = "[process.W]\nbody = \"loop { work }\"\n[executor.main]\n\
                [system.part.pool]\nprocess = \"W\"\npriority = 9\non = \"main\"\n";
    let model = Model::parse("m.toml", text).unwrap();
    for order in [[("pool", 3), ("pool ", 9)], [("pool ", 9), ("pool", 3)]] {
        let system = idle(&order);
        let wiring = system.check_wiring(&model).unwrap_err();
        let [difference] = &wiring.differences[..] else {
            panic!("{wiring}");
        };
        let expected = "process `pool`: priority 3, in the model 9";
        assert_eq!(difference.to_string(), expected);
    }
}

#[test]
fn names_of_a_model_that_are_one_in_a_system_are_named() {
    let text = "[process.W]\nbody = \"loop { work }\"\n[executor.main]\n\
                [system.part.a]\nprocess = \"W\"\narray = 1\n\
                [system.part.a_0]\nprocess = \"W\"\n";
    let model = Model::parse("m.toml", text).unwrap();
    let wiring = idle(&[("a[0]", 3)]).check_wiring(&model).unwrap_err();
    let expected = "process `a_0`: the same name as `a[0]`, in the model another one";
    assert_eq!(wiring.differences[0].to_string(), expected, "{wiring}");
}

#[test]
fn a_large_buffer_and_a_process_outside_are_as_their_own_model_says() {
    let mut system = System::new("pair");
    let observer = system.observer();
    let main = system.executor("main").build().unwrap();
    let (sender, receiver) = luna::buffered::<u32>(Buffer::fifo(1000));
    sender.try_send(1).unwrap();
    let outside = main.process("outside").priority(2);
    outside
        .spawn(async move {
            receiver.recv().await?;
            let text = observer.model();
            assert!(text.contains("buffer = \"fifo 255\" # of 1000\n"), "{text}");
            let model = Model::parse("ran.toml", &text).unwrap();
            assert_eq!(observer.check_wiring(&model), Ok(()));
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    drop(sender);
}
