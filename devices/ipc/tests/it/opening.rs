//! What is refused when a side is opened.

use crate::{Block, channel_name, files};
use luna::System;
use luna_ipc::{Endpoint, IpcError, Role, ZeroCopySend};

#[test]
fn one_program_for_each_role() {
    let name = channel_name("busy");
    let (_sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    let error = luna_ipc::sender::<u64>(&name).unwrap_err();
    let own = std::process::id();
    assert!(
        matches!(&error, IpcError::Busy { role: Role::Sender, pid, .. } if *pid == own),
        "{error}"
    );
    assert!(error.to_string().contains(&name), "{error}");
    let (_receiver, _link) = luna_ipc::receiver::<u64>(&name).unwrap();
    assert!(luna_ipc::receiver::<u64>(&name).is_err());
}

#[test]
fn another_type_is_an_error_that_names_both() {
    /// As large as a `Block`, and another one.
    #[repr(C)]
    #[derive(ZeroCopySend)]
    #[type_name("luna_ipc_test::Door")]
    struct Door {
        angle: f64,
        state: u64,
    }
    let name = channel_name("type");
    let (_sender, link) = luna_ipc::sender::<Block>(&name).unwrap();
    let error = luna_ipc::receiver::<Door>(&name).unwrap_err().to_string();
    for part in ["luna_ipc_test::Block", "luna_ipc_test::Door", "16 bytes"] {
        assert!(error.contains(part), "{error}");
    }
    let error = luna_ipc::receiver::<u64>(&name).unwrap_err().to_string();
    assert!(error.contains("`u64` (8 bytes"), "{error}");
    let versioned = Endpoint::new(&name).layout_version(3);
    let error = versioned.receiver::<Block>().unwrap_err();
    let IpcError::Type { here, there, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!((here.version, there.version), (3, 0));
    // The refused ones have left nothing, and the right one may join.
    let (_receiver, _link) = luna_ipc::receiver::<Block>(&name).unwrap();
    assert_eq!(files(&name).len(), 4);
    drop(link);
}

#[test]
fn names_that_cannot_be() {
    for name in ["", "two words", "../../etc/passwd\0", &"x".repeat(181)] {
        let error = luna_ipc::sender::<u64>(name).unwrap_err();
        assert!(matches!(error, IpcError::Name { .. }), "{error}");
    }
    // Dots and slashes are only characters.
    let (_sender, _link) = luna_ipc::sender::<u64>(&channel_name("../up")).unwrap();
}

#[test]
fn nothing_is_left_when_both_sides_are_dropped() {
    for sender_last in [false, true] {
        let name = channel_name("dropped");
        let sending = luna_ipc::sender::<u64>(&name).unwrap();
        let receiving = luna_ipc::receiver::<u64>(&name).unwrap();
        if sender_last {
            drop(receiving);
            assert_eq!(files(&name).len(), 4);
            drop(sending);
        } else {
            drop(sending);
            assert_eq!(files(&name).len(), 4);
            drop(receiving);
        }
        assert!(files(&name).is_empty());
    }
}

#[test]
fn a_virtual_clock_is_refused() {
    let name = channel_name("virtual");
    let (_sender, link) = luna_ipc::sender::<u64>(&name).unwrap();
    let mut system = System::new("simulated");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    main.process("link").spawn(link).unwrap();
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("virtual clock"), "{error}");
}
