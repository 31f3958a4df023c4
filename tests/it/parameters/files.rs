//! A file that is read again.

use super::*;
use crate::common::SpawnOk;

#[test]
fn the_file_again_makes_what_a_start_would() {
    let _watch = watchdog();
    let file = TempFile::with("again", "count = 4\n[pan]\nkp = 3.0\n");
    let mut system = System::new("reload");
    system
        .virtual_clock()
        .parameters_from(&file.0)
        .set_parameter("offset", 5);
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let path = file.0.display().to_string();
    let body = async move |all: &All| {
        let (kp, limit, _, offset, is_on, mode, gains) = DEFAULTS;
        assert_eq!(all.get(), (3.0, limit, 4, 5, is_on, mode, gains));
        parameters.set([("pan/limit", 0.25), ("pan/kp", 9.0)])?;
        file.write("count = 5\n");
        let set = parameters.reload()?;
        all.kp.latch();
        assert_eq!(all.get(), (kp, limit, 5, 5, is_on, mode, gains));
        assert!(parameters.is_taken(set));
        // Nothing of one that is wrong.
        file.write("count = 6\nkount = 7\n");
        let error = parameters.reload().unwrap_err();
        assert_eq!(
            error.to_string(),
            format!(
                "no parameter was set: {path}:2: `kount` = 7: there is no such parameter; did you mean `count`?"
            )
        );
        all.kp.latch();
        assert_eq!(all.get(), (kp, limit, 5, offset + 12, is_on, mode, gains));
        Ok(())
    };
    spawn_with(main.process("all"), All::declare, body).unwrap();
    system.run().unwrap();
    assert!(matches!(
        system.parameters().reload(),
        Err(SetError::NotRunning { .. })
    ));
    assert_eq!(
        System::new("none").parameters().reload(),
        Err(SetError::NoFile)
    );
}

#[test]
fn a_file_that_changes_is_read_again_if_that_is_asked_for() {
    let _watch = watchdog();
    let file = TempFile::with("watched", "count = 4\n");
    let mut system = System::new("watch");
    system
        .parameters_from(&file.0)
        .reload_parameters_on_change();
    let main = system.executor("main").build().unwrap();
    let body = async move |all: &All| {
        assert_eq!(all.count.get(), 4);
        let mut tick = luna::periodic("loop", MS)?;
        // Of another length too, since file times may be coarse.
        file.replace("count = 77 \n\n");
        while all.count.get() == 4 {
            tick.next().await;
        }
        assert_eq!(all.count.get(), 77);
        Ok(())
    };
    spawn_with(main.process("all"), All::declare, body).unwrap();
    system.run().unwrap();
}

/// What the start has read is older than what is there when the first process runs.
#[test]
fn a_file_that_changes_during_the_start_is_read_again() {
    let _watch = watchdog();
    let file = TempFile::with("slow", "count = 4\n");
    let mut system = System::new("slow start");
    system
        .parameters_from(&file.0)
        .reload_parameters_on_change();
    let main = system.executor("main").build().unwrap();
    struct Replaces(All, TempFile);
    impl Process for Replaces {
        fn pre_run(&mut self) -> luna::Result<()> {
            assert_eq!(self.0.count.get(), 4);
            self.1.replace("count = 77 \n\n");
            Ok(())
        }

        async fn run(&mut self) -> luna::Result<()> {
            let mut tick = luna::periodic("loop", MS)?;
            while self.0.count.get() == 4 {
                tick.next().await;
            }
            assert_eq!(self.0.count.get(), 77);
            Ok(())
        }
    }
    let process = main.process("all");
    let all = All::declare(&process).unwrap();
    process.spawn_ok(Replaces(all, file));
    system.run().unwrap();
}
