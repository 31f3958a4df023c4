//! Parameters that are declared where their process is spawned, and moved into its body.

use super::*;
use crate::common::SpawnOk;

#[test]
fn a_handle_has_the_default_until_the_start_and_then_what_was_set() {
    let _watch = watchdog();
    let file = TempFile::with("moved", "[pan]\nkp = 2.5\ngains = [4, 5]\n");
    let mut system = System::new("moved");
    system.virtual_clock().parameters_from(&file.0);
    system.set_parameter("pan/kd", 0.5);
    let main = system.executor("main").build().unwrap();
    let pan = main.process("pan").priority(20);
    let kp = pan.parameter("pan/kp", 2.0).register().unwrap();
    let kd = pan.parameter("pan/kd", 0.1).register().unwrap();
    let gains = pan.parameter("pan/gains", [1.0, 2.0]).register().unwrap();
    let (outside, parameters) = (gains.clone(), system.parameters());
    let defaults = (kp.get(), kd.get(), gains.get());
    assert_eq!(defaults, (2.0, 0.1, [1.0, 2.0]));
    let listed = parameters.list();
    assert_eq!(
        (listed.len(), &*listed[0].processes),
        (3, &["pan".to_owned()][..])
    );
    assert!(
        parameters.set([("pan/kp", 3.0)]).is_err(),
        "not before the start"
    );
    pan.spawn_ok(async move {
        let mut tick = luna::periodic("pan", MS)?;
        assert_eq!((kp.get(), kd.get(), gains.get()), (2.5, 0.5, [4.0, 5.0]));
        parameters.set_text("pan/kp=3, pan/gains=[6, 7]")?;
        assert_eq!((kp.get(), gains.get()), (2.5, [4.0, 5.0]));
        tick.next().await;
        assert_eq!((kp.get(), kd.get(), gains.get()), (3.0, 0.5, [6.0, 7.0]));
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(outside.get(), [6.0, 7.0]);
}

/// The first values are there when the first `pre_run` runs, also for what another process has.
#[test]
fn a_type_with_three_phases_has_its_parameters_as_fields() {
    let _watch = watchdog();
    struct Axis(Parameter<u32>);
    impl Process for Axis {
        fn pre_run(&mut self) -> luna::Result<()> {
            assert_eq!(self.0.get(), 7);
            Ok(())
        }

        async fn run(&mut self) -> luna::Result<()> {
            assert_eq!(self.0.get(), 7);
            Ok(())
        }
    }
    let mut system = System::new("fields");
    system.set_parameter("axis/count", 7);
    let axis = system.thread("axis").process("axis");
    let count = axis.parameter("axis/count", 1).register().unwrap();
    axis.spawn_ok(Axis(count));
    system.run().unwrap();
}

#[test]
fn branches_of_one_process_take_a_set_together() {
    let _watch = watchdog();
    let mut system = System::new("branches");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let both = main.process("both");
    let gain = both.parameter("gain", 1).register().unwrap();
    let parameters = system.parameters();
    both.spawn_ok(async move {
        let other = gain.clone();
        par!(
            async {
                luna::after(5 * MS).await;
                parameters.set([("gain", 2)])?;
                // It has no loop; the other branch has.
                assert_eq!(other.get(), 1);
                luna::after(2 * MS).await;
                assert_eq!(other.get(), 2);
                Ok(())
            },
            async {
                let mut tick = luna::periodic("both", MS)?;
                while gain.get() == 1 {
                    tick.next().await;
                }
                Ok(())
            },
        )
        .await?;
        Ok(())
    });
    system.run().unwrap();
}

/// The start has values for it, and the processes that its `pre_run` spawns have theirs.
#[test]
fn a_process_that_is_spawned_in_a_pre_run_has_the_first_values_at_once() {
    let _watch = watchdog();
    struct Spawns(luna::system::Executor);
    impl Process for Spawns {
        fn pre_run(&mut self) -> luna::Result<()> {
            let child = self.0.process("child");
            let gain = child.parameter("child/gain", 1).register()?;
            assert_eq!(gain.get(), 9);
            child.spawn(async move {
                assert_eq!(gain.get(), 9);
                Ok(())
            })?;
            Ok(())
        }

        async fn run(&mut self) -> luna::Result<()> {
            Ok(())
        }
    }
    let mut system = System::new("spawns");
    system.virtual_clock().set_parameter("child/gain", 9);
    let main = system.executor("main").build().unwrap();
    main.process("parent").spawn_ok(Spawns(main.clone()));
    drop(main);
    system.run().unwrap();
}

/// As in a program that reports the error with `?`: nothing says that the system never ran.
#[test]
fn what_cannot_be_declared_is_an_error_of_register() {
    let mut system = System::new("twice");
    let main = system.executor("main").build().unwrap();
    let pan = main.process("pan");
    let _kp = pan.parameter("kp", 2.0).register().unwrap();
    let twice: Error = main
        .process("tilt")
        .parameter("kp", 2.0)
        .register()
        .unwrap_err()
        .into();
    assert_eq!(
        twice.to_string(),
        "process `pan` has a parameter `kp` already; give each a name of its own, or declare it as shared in all processes that read it"
    );
}
