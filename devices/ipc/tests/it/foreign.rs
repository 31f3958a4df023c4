//! Files that are not this user's alone, and locks that others hold: neither is joined or waited
//! for without an end.

use crate::shared::{skip, watchdog};
use crate::{channel_name, files, leaving_files, run};
use luna::Policy;
use luna_ipc::{Blackboard, IpcError, look};
use nix::fcntl::{FcntlArg, fcntl};
use nix::sys::stat::Mode;
use std::fs::{self, OpenOptions, Permissions};
use std::os::unix::fs::{PermissionsExt, chown, symlink};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A user as whom no test runs.
const OTHER: u32 = 65533;

fn path(name: &str, file: &str) -> PathBuf {
    PathBuf::from(format!(
        "/dev/shm/luna-ipc.{}.{file}",
        name.replace('/', "+")
    ))
}

fn is_foreign<T>(opened: Result<T, IpcError>, part: &str) {
    let Err(error) = opened else {
        panic!("what should be refused, since {part}, is opened");
    };
    assert!(matches!(error, IpcError::Foreign { .. }), "{error}");
    assert!(error.to_string().contains(part), "{error}");
}

/// Files as another user may put them there; not as a plain user, that cannot give files away.
fn give_away(path: &PathBuf) -> bool {
    let is_given = chown(path, Some(OTHER), Some(OTHER)).is_ok();
    if !is_given {
        skip("the part with another user's files: this user cannot make such");
    }
    is_given
}

#[test]
fn files_of_another_user_are_not_joined() {
    let _left = leaving_files();
    let name = channel_name("owner");
    let (_sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    for file in ["lock", "words"] {
        let path = path(&name, file);
        if !give_away(&path) {
            return;
        }
        let part = "belongs to user 65533";
        is_foreign(luna_ipc::receiver::<u64>(&name), part);
        is_foreign(Blackboard::new(&name).read(), part);
        is_foreign(look::at(&name), part);
        assert!(look::all().unwrap().hidden > 0);
        luna_ipc::clean_up().unwrap();
        assert!(path.exists(), "it is another user's");
        chown(&path, Some(nix::unistd::geteuid().as_raw()), None).unwrap();
    }
    let (_receiver, _link) = luna_ipc::receiver::<u64>(&name).unwrap();
}

/// A lock file of another user is there before the channel's: the name is taken, and nothing of it
/// is used.
#[test]
fn a_name_that_another_user_has_taken_is_an_error() {
    let _left = leaving_files();
    let name = channel_name("taken");
    let path = path(&name, "lock");
    fs::write(&path, "").unwrap();
    fs::set_permissions(&path, Permissions::from_mode(0o666)).unwrap();
    if give_away(&path) {
        is_foreign(luna_ipc::sender::<u64>(&name), "belongs to user");
        is_foreign(
            Blackboard::new(&name).entry("x", 1_u8).write(),
            "belongs to user",
        );
    }
    fs::remove_file(&path).unwrap();
}

#[test]
fn a_bell_of_another_user_is_not_rung() {
    let _watchdog = watchdog();
    let name = channel_name("bell");
    let (sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    if !give_away(&path(&name, "sender")) {
        return;
    }
    let (receiver, link) = luna_ipc::receiver::<u64>(&name).unwrap();
    let ended = run(Policy::Other, link, async move {
        assert!(receiver.recv().await.is_err());
        Ok(())
    });
    let error = ended.unwrap_err().to_string();
    assert!(error.contains("belongs to user 65533"), "{error}");
    drop(sender);
}

/// What lets others in, also if it is this user's.
#[test]
fn files_that_let_other_users_in_are_not_joined() {
    let _left = leaving_files();
    let name = channel_name("mode");
    let (_sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    for file in ["lock", "words"] {
        let path = path(&name, file);
        for mode in [0o666, 0o640, 0o606] {
            fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
            is_foreign(luna_ipc::receiver::<u64>(&name), &format!("mode, {mode:o}"));
            is_foreign(look::at(&name), "mode");
        }
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        let second = path.with_extension("second");
        fs::hard_link(&path, &second).unwrap();
        is_foreign(luna_ipc::receiver::<u64>(&name), "another name");
        fs::remove_file(second).unwrap();
    }
    let (_receiver, _link) = luna_ipc::receiver::<u64>(&name).unwrap();
}

/// A FIFO would keep waiting whoever opens it to read; a link would lead elsewhere.
#[test]
fn what_is_no_file_is_not_opened() {
    let _watchdog = watchdog();
    let _left = leaving_files();
    let name = channel_name("kind");
    let path = path(&name, "lock");
    let fifo = || nix::unistd::mkfifo(&path, Mode::S_IRUSR | Mode::S_IWUSR).unwrap();
    let link = || symlink("/etc/passwd", &path).unwrap();
    let folder = || fs::create_dir(&path).unwrap();
    let makes: [&dyn Fn(); 3] = [&fifo, &link, &folder];
    for make in makes {
        make();
        is_foreign(luna_ipc::sender::<u64>(&name), "no regular file");
        is_foreign(look::at(&name), "no regular file");
        luna_ipc::clean_up().unwrap();
        fs::remove_file(&path)
            .or_else(|_| fs::remove_dir(&path))
            .unwrap();
    }
}

/// As a program does that was stopped while it opened or closed the channel.
#[test]
fn a_lock_that_is_held_is_waited_for_a_bounded_time() {
    let _watchdog = watchdog();
    let _left = leaving_files();
    let name = channel_name("locked");
    let sending = luna_ipc::sender::<u64>(&name).unwrap();
    let lock = path(&name, "lock");
    let holder = OpenOptions::new().read(true).write(true).open(&lock);
    let holder = holder.unwrap();
    let range = libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 1,
        l_pid: 0,
    };
    fcntl(&holder, FcntlArg::F_OFD_SETLK(&range)).unwrap();
    let begin = Instant::now();
    luna_ipc::clean_up().unwrap();
    assert!(lock.exists());
    // It opens the files of all channels, and waits for none.
    assert!(begin.elapsed() < Duration::from_secs(4));
    let error = luna_ipc::receiver::<u64>(&name).unwrap_err();
    let IpcError::Held { waited, .. } = &error else {
        panic!("{error}");
    };
    assert!(*waited >= Duration::from_secs(5), "{error}");
    for part in [&name, lock.to_str().unwrap(), "fuser", "5 s"] {
        assert!(error.to_string().contains(part), "{error}");
    }
    // Closing goes on too: the role ends with the file.
    drop(sending);
    drop(holder);
    let (_sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    assert_eq!(files(&name).len(), 3);
}
