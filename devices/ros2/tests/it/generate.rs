//! Types from `.msg` and `.srv` files.

use luna_ros2::generate::{GenerateError, folder, packages};
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

const TANK: &str = "\
# A tank.

uint8 EMPTY=0
uint8 FULL = 0x02 # to the brim
string UNIT='m # of water'
float32 HALF=0.5

# How full it is.
uint8 state 1
string<=16 name \"main\" # of the tank
float64[3] levels [1.0, 2, 3]
float64[40] history
int16[<=4] alarms
bool type
Valve[] valves
std_msgs/Header header
geometry_msgs/Point place
";

#[test]
fn constants_defaults_bounds_and_other_messages() {
    let files = [
        ("tank_msgs/msg/Tank.msg", TANK),
        ("tank_msgs/msg/Valve.msg", "bool open\n"),
        ("tank_msgs/srv/Fill.srv", "float64 to\n---\n"),
    ];
    let here = Folder::new("tank", &files);
    let all = packages(&here.0).unwrap();
    assert_eq!(all.len(), 1);
    let text = &all[0].1;
    for part in [
        "luna_ros2::message! {\n    /// A tank.\n    pub struct Tank: \"tank_msgs/msg/Tank\" {",
        "pub const EMPTY: u8 = 0;",
        "/// to the brim\n    pub const FULL: u8 = 2;",
        "pub const UNIT: &'static str = \"m # of water\";",
        "pub const HALF: f32 = 0.5;",
        "/// How full it is.\n        pub state: u8,",
        "state: 1,",
        "/// of the tank\n        pub name: luna_ros2::arrayvec::ArrayString<16>,",
        "name: luna_ros2::arrayvec::ArrayString::from(\"main\").unwrap_or_default(),",
        "pub levels: [f64; 3],",
        "levels: [1.0, 2.0, 3.0],",
        "#[serde(with = \"luna_ros2::big_array\")]\n        pub history: [f64; 40],",
        "pub alarms: luna_ros2::arrayvec::ArrayVec<i16, 4>,",
        "pub r#type: bool,",
        "pub valves: Vec<Valve>,",
        "pub header: luna_ros2::msg::std_msgs::Header,",
        "pub place: luna_ros2::msg::geometry_msgs::Point,",
        "#[derive(Copy, Default)]\n    pub struct Valve: \"tank_msgs/msg/Valve\" {",
        "pub struct FillReply {\n        /// Without meaning.\n        pub structure_needs_at_least_one_member: u8,",
        "type Request = FillRequest;",
        "const TYPE: &'static str = \"tank_msgs/srv/Fill\";",
    ] {
        assert!(text.contains(part), "{part}\n\nis not in\n\n{text}");
    }
    let out = here.0.join("out.rs");
    folder(&here.0, &out).unwrap();
    let written = fs::read_to_string(out).unwrap();
    assert!(written.contains("pub mod tank_msgs {\n"), "{written}");
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
