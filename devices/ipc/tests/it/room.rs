//! Shared memory is taken when a side is opened: where there is too little, that fails, and nothing
//! later does.

use crate::shared::skip;
use crate::{channel_name, files};
use luna_ipc::{Blackboard, Endpoint, IpcError, ZeroCopySend};
use nix::mount::{MsFlags, mount};
use nix::sched::{CloneFlags, unshare};
use nix::sys::resource::{UsageWho, getrusage};

#[repr(C)]
#[derive(Clone, Copy, Debug, ZeroCopySend)]
struct Big([u8; 65536]);

const BIG: Big = Big([7; 65536]);

/// Runs it in a thread that sees a `/dev/shm` of its own, of so many bytes and files; not without
/// privileges.
fn in_small_folder((kilobytes, files): (u32, u32), job: impl FnOnce() + Send + 'static) {
    let small = move || {
        let none = None::<&str>;
        let private = MsFlags::MS_REC | MsFlags::MS_PRIVATE;
        let size = format!("size={kilobytes}k,nr_inodes={files},mode=1777");
        let made = unshare(CloneFlags::CLONE_NEWNS)
            .and_then(|()| mount(none, "/", none, private, none))
            .and_then(|()| {
                let (kind, flags) = (Some("tmpfs"), MsFlags::empty());
                mount(Some("tmpfs"), "/dev/shm", kind, flags, Some(&*size))
            });
        match made {
            Ok(()) => job(),
            Err(error) => skip(&format!("a mount namespace cannot be had: {error}")),
        }
    };
    // Of the test's name, which a line about leaving it out shows.
    let name = std::thread::current().name().unwrap().to_owned();
    let thread = std::thread::Builder::new().name(name).spawn(small);
    thread.unwrap().join().unwrap();
}

/// The error names what is needed, what is free and what helps; nothing is left.
fn is_refused<T>(opened: Result<T, IpcError>, name: &str) {
    let Err(error) = opened else {
        panic!("{name} opens, and its first access would be the end of the program");
    };
    let IpcError::Room {
        size,
        free,
        in_folder,
        ..
    } = &error
    else {
        panic!("{error}");
    };
    assert!(*size > 65536 && *free <= 40 << 10 && *in_folder, "{error}");
    for part in [&size.to_string(), &free.to_string(), "--shm-size", name] {
        assert!(error.to_string().contains(part), "{error}");
    }
    assert_eq!(files(name), [""; 0]);
}

#[test]
fn too_little_of_it_is_an_error_of_the_opening() {
    in_small_folder((40, 99), || {
        let name = channel_name("small");
        let endpoint = Endpoint::new(&name);
        is_refused(endpoint.sender::<Big>(), &name);
        is_refused(endpoint.receiver::<Big>(), &name);
        is_refused(endpoint.client::<u8, Big>(), &name);
        is_refused(endpoint.server::<Big, u8>(), &name);
        is_refused(endpoint.loan_sender(4, &BIG), &name);
        is_refused(endpoint.loan_receiver::<Big>(4), &name);
        #[cfg(feature = "serde")]
        is_refused(endpoint.serde_sender::<String>(65536), &name);
        let board = Blackboard::new(&name).entry("large", BIG);
        is_refused(board.write(), &name);
        // What fits is opened, beside what does not.
        let (_sender, _link) = endpoint.sender::<[u8; 4096]>().unwrap();
    });
}

#[test]
fn a_folder_that_others_fill_is_an_error_of_the_opening() {
    in_small_folder((256, 99), || {
        let name = channel_name("filled");
        let filled = (0..).take_while(|number| {
            let page = [1; 4096];
            std::fs::write(format!("/dev/shm/filler-{number}"), page).is_ok()
        });
        assert!(filled.count() > 32);
        let error = luna_ipc::sender::<Big>(&name).unwrap_err();
        assert!(
            matches!(
                error,
                IpcError::Room { free: 0, .. } | IpcError::System { .. }
            ),
            "{error}"
        );
        assert_eq!(files(&name), [""; 0]);
    });
}

/// Of the folder itself, the lock file and the shared memory: there is none for the bell.
#[test]
fn a_folder_with_room_for_no_more_files_is_an_error_of_the_opening() {
    in_small_folder((256, 3), || {
        let name = channel_name("files");
        let error = luna_ipc::sender::<u64>(&name).unwrap_err();
        assert!(matches!(error, IpcError::System { .. }), "{error}");
        assert!(error.to_string().contains("df -i"), "{error}");
        assert_eq!(files(&name), [""; 0]);
    });
}

/// A segment that another program has only made longer, without taking its memory.
#[test]
fn what_a_partner_has_not_taken_is_taken_or_refused() {
    in_small_folder((256, 99), || {
        let name = channel_name("sparse");
        let (_sender, _link) = luna_ipc::sender::<Big>(&name).unwrap();
        let words = format!("/dev/shm/luna-ipc.{}.words", name.replace('/', "+"));
        let head = std::fs::read(&words).unwrap();
        let file = std::fs::File::create(&words).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &head[..4096], 0).unwrap();
        file.set_len(head.len() as u64).unwrap();
        let filler = vec![1; 200 << 10];
        std::fs::write("/dev/shm/filler", filler).unwrap();
        let error = luna_ipc::receiver::<Big>(&name).unwrap_err();
        assert!(matches!(error, IpcError::Room { .. }), "{error}");
        let error = luna_ipc::look::at(&name).unwrap_err();
        assert!(matches!(error, IpcError::Protocol { .. }), "{error}");
        std::fs::remove_file("/dev/shm/filler").unwrap();
        let (_receiver, _link) = luna_ipc::receiver::<Big>(&name).unwrap();
    });
}

fn faults() -> i64 {
    getrusage(UsageWho::RUSAGE_THREAD)
        .unwrap()
        .minor_page_faults()
}

/// The bytes of the mappings of a file, those that are in memory, and those of mappings that are
/// locked.
fn mapped(words: &str) -> [u64; 3] {
    let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
    let mut sums = [0; 3];
    let (mut is_this, mut size) = (false, 0);
    for line in maps.lines() {
        let (key, value) = line.split_once(' ').unwrap_or((line, ""));
        let kilobytes = || value.trim().trim_end_matches(" kB").parse::<u64>().unwrap();
        match key {
            _ if !key.ends_with(':') => is_this = line.ends_with(words),
            "Size:" if is_this => {
                size = kilobytes() << 10;
                sums[0] += size;
            }
            "Rss:" if is_this => sums[1] += kilobytes() << 10,
            "VmFlags:" if is_this && value.split(' ').any(|flag| flag == "lo") => sums[2] += size,
            _ => {}
        }
    }
    sums
}

/// Both sides, so twice the segment: in memory, and locked where the system allows it.
#[test]
fn it_is_in_memory_before_it_is_used() {
    let name = channel_name("touched");
    let endpoint = Endpoint::new(&name);
    let (loans, _sender, sends) = endpoint.loan_sender(2, &BIG).unwrap();
    let (_receiver, receives) = endpoint.loan_receiver::<Big>(2).unwrap();
    let words = format!("luna-ipc.{}.words", name.replace('/', "+"));
    let [size, resident, locked] = mapped(&words);
    assert!(size > 4 * 65536);
    assert_eq!(resident, size);
    match sends.status().is_locked() && receives.status().is_locked() {
        true => assert_eq!(locked, size),
        false => skip("whether it is locked: the limit of locked memory is too low"),
    }
    let mut loan = loans.loan().unwrap();
    let before = faults();
    for byte in loan.0.iter_mut().step_by(4096) {
        *byte = 1;
    }
    // Sixteen pages; this test's own code may be new to it.
    let faults = faults() - before;
    assert!(
        faults < 8,
        "the first access waits for the kernel: {faults} times"
    );
}

#[test]
fn sizes_beyond_all_addresses_are_errors() {
    let name = channel_name("sizes");
    let endpoint = Endpoint::new(&name);
    let is_size = |error: IpcError| {
        assert!(matches!(error, IpcError::Size { .. }), "{error}");
        assert!(error.to_string().contains(&name), "{error}");
    };
    #[cfg(feature = "serde")]
    for capacity in [usize::MAX, usize::MAX - 8, isize::MAX as usize] {
        is_size(endpoint.serde_sender::<String>(capacity).unwrap_err());
        is_size(endpoint.serde_receiver::<String>(capacity).unwrap_err());
        is_size(
            endpoint
                .serde_client::<String, String>(8, capacity)
                .unwrap_err(),
        );
        is_size(
            endpoint
                .serde_server::<String, String>(capacity, capacity)
                .unwrap_err(),
        );
    }
    for slots in [usize::MAX, usize::MAX / 8, 1 << 47] {
        is_size(endpoint.loan_sender(slots, &BIG).unwrap_err());
        is_size(endpoint.loan_receiver::<Big>(slots).unwrap_err());
    }
    // There are addresses, and no memory.
    let error = endpoint.loan_receiver::<Big>(1 << 30).unwrap_err();
    assert!(matches!(error, IpcError::Room { .. }), "{error}");
    assert_eq!(files(&name), [""; 0]);
}
