//! Types from `.msg` and `.srv` files.

use luna_ros2::generate::{GenerateError, folder, packages};
use luna_ros2::{Message, Service};
use std::fs;
use std::path::PathBuf;

/// A folder that is gone with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str, files: &[(&str, &str)]) -> Self {
        let path = std::env::temp_dir().join(format!("luna-ros2-{test}-{}", std::process::id()));
        for (name, text) in files {
            let file = path.join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, text).unwrap();
        }
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The crate's own messages are what the generator makes of its folder. With LUNA_GENERATE=1 this
/// writes them.
#[test]
fn the_crates_messages_are_what_the_generator_makes() {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/msg");
    let all = packages(own).unwrap();
    assert_eq!(all.len(), 8);
    for (package, body) in all {
        let doc = format!("//! Interfaces of the package `{package}`.\n\n");
        let path = format!("{}/src/msg/{package}.rs", env!("CARGO_MANIFEST_DIR"));
        let text = doc + &body;
        if std::env::var_os("LUNA_GENERATE").is_some() {
            fs::write(&path, &text).unwrap();
        }
        let there = fs::read_to_string(&path).unwrap();
        assert!(
            there == text,
            "{path} is old: run this test with LUNA_GENERATE=1"
        );
    }
}

/// What the generator makes of `tests/msg`, as a package outside the crate has it.
#[allow(
    dead_code,
    unreachable_pub,
    reason = "a package has it in its public interface"
)]
mod made {
    include!("../msg/made.rs");
}

/// `tests/msg` has constants, defaults, bounds, and messages of other packages. With
/// LUNA_GENERATE=1 this writes `made.rs`.
#[test]
fn a_package_outside_the_crate() {
    let msg = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/msg");
    let made = PathBuf::from(msg).join("made.rs");
    let here = Folder::new("made", &[]);
    let out = here.0.join("made.rs");
    folder(msg, &out).unwrap();
    if std::env::var_os("LUNA_GENERATE").is_some() {
        fs::copy(&out, &made).unwrap();
    }
    assert!(
        fs::read_to_string(&out).unwrap() == fs::read_to_string(&made).unwrap(),
        "tests/msg/made.rs is old: run this test with LUNA_GENERATE=1"
    );
}

#[test]
fn constants_defaults_and_bounds() {
    use made::tank_msgs::{Fill, FillReply, Tank, Valve};
    assert_eq!((Tank::EMPTY, Tank::FULL), (0, 2));
    assert_eq!((Tank::UNIT, Tank::HALF), ("m # of water", 0.5));
    let tank = Tank::default();
    assert_eq!((tank.state, tank.name.as_str()), (1, "main"));
    assert_eq!((tank.name.capacity(), tank.alarms.capacity()), (16, 4));
    assert_eq!((tank.levels, tank.history), ([1.0, 2.0, 3.0], [0.0; 40]));
    assert_eq!((tank.r#type, tank.valves), (false, vec![]));
    assert_eq!(tank.header, luna_ros2::msg::std_msgs::Header::default());
    assert_eq!(<Valve as Message>::TYPE, "tank_msgs/msg/Valve");
    assert_eq!(<Fill as Service>::TYPE, "tank_msgs/srv/Fill");
    // A reply without fields has one on the wire.
    assert_eq!(FillReply::default().structure_needs_at_least_one_member, 0);
}

#[test]
fn what_has_no_type_is_refused_with_its_line() {
    for (text, line, what) in [
        ("int32 a\nwstring b\n", 2, "`wstring`"),
        ("int32 a\n\nUnknown b\n", 3, "there is no `x_msgs/Unknown`"),
        ("far_msgs/Thing b\n", 1, "far_msgs/msg/Thing.msg"),
        ("int32\n", 1, "has no name"),
        ("int32 a\nint32 a\n", 2, "`a` is there twice"),
        ("int32 Big\n", 1, "`Big` is no field's name"),
        ("int8 a 200\n", 1, "`200` is no `i8`"),
        ("uint8 LARGE=256\n", 1, "`256` is no `u8`"),
        ("int32[0] a\n", 1, "whole number from 1"),
        ("int32[2] a [1]\n", 1, "has 1 elements, not 2"),
        ("int32<=3 a\n", 1, "only strings and lists have a bound"),
        ("int32 a]\n", 1, "is no field's name"),
        ("Bad self\n", 1, "there is no `x_msgs/Bad`"),
        ("Self inner\n", 1, "contains itself"),
        ("int32 a\n---\nint32 b\n", 1, "a message has no line `---`"),
    ] {
        let name = if what == "contains itself" {
            "Self"
        } else {
            "Case"
        };
        let file = format!("x_msgs/msg/{name}.msg");
        let here = Folder::new("refused", &[(&file, text)]);
        let error = packages(&here.0).unwrap_err();
        let GenerateError::Refused { path, line: at, .. } = &error else {
            panic!("{text}: {error}");
        };
        assert!(path.ends_with(&file), "{error}");
        assert_eq!(*at, line, "{text}: {error}");
        assert!(error.to_string().contains(what), "{text}: {error}");
    }
    let error = packages(&Folder::new("empty", &[]).0).unwrap_err();
    assert!(matches!(error, GenerateError::Empty { .. }), "{error}");
    let error = packages("/nowhere").unwrap_err();
    assert!(error.to_string().starts_with("/nowhere"), "{error}");
}
