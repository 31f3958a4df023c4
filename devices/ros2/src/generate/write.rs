//! The Rust text.

use super::GenerateError;
use super::parse::{Interface, Member, Part, Parts};
use super::types::{Base, Count, Type};
use std::collections::BTreeMap;
use std::fmt::Write;

/// What `luna_ros2::msg` has, and whether it is `Copy`.
const KNOWN: &[(&str, &str, bool)] = &[
    ("builtin_interfaces", "Duration", true),
    ("builtin_interfaces", "Time", true),
    ("geometry_msgs", "Point", true),
    ("geometry_msgs", "Pose", true),
    ("geometry_msgs", "PoseStamped", false),
    ("geometry_msgs", "PoseWithCovariance", true),
    ("geometry_msgs", "Quaternion", true),
    ("geometry_msgs", "Transform", true),
    ("geometry_msgs", "TransformStamped", false),
    ("geometry_msgs", "Twist", true),
    ("geometry_msgs", "TwistStamped", false),
    ("geometry_msgs", "TwistWithCovariance", true),
    ("geometry_msgs", "Vector3", true),
    ("geometry_msgs", "Wrench", true),
    ("std_msgs", "Header", false),
];

/// The messages that fields may name: those of the folder, and those of the crate.
struct Names<'a> {
    own: BTreeMap<(&'a str, &'a str), &'a Interface>,
}

/// The bodies of the packages' modules.
pub(super) fn packages(interfaces: &[Interface]) -> Result<Vec<(String, String)>, GenerateError> {
    let messages = interfaces
        .iter()
        .filter(|interface| matches!(interface.parts, Parts::Message(_)));
    let names = Names {
        own: messages
            .map(|interface| ((&*interface.package, &*interface.name), interface))
            .collect(),
    };
    let mut packages = BTreeMap::<&str, String>::new();
    for interface in interfaces {
        let body = packages.entry(&interface.package).or_default();
        let name = &interface.name;
        match &interface.parts {
            Parts::Message(part) => {
                let path = format!(": \"{}/msg/{name}\"", interface.package);
                names.item(body, interface, part, name, (&path, "A message"))?;
                body.push('\n');
            }
            Parts::Service(request, reply) => {
                let path = format!("{}/srv/{name}", interface.package);
                let (asks, answers) = (format!("{name}Request"), format!("{name}Reply"));
                names.item(body, interface, request, &asks, ("", "A request"))?;
                body.push('\n');
                names.item(body, interface, reply, &answers, ("", "A reply"))?;
                let _ = writeln!(
                    body,
                    "\n/// The service `{path}`.\n#[derive(Debug)]\npub enum {name} {{}}\n\n\
                     impl luna_ros2::Service for {name} {{\n    type Request = {asks};\n    \
                     type Reply = {answers};\n    const TYPE: &'static str = {path:?};\n}}\n"
                );
            }
        }
    }
    let packages = packages.into_iter();
    Ok(packages
        .map(|(name, body)| (name.to_owned(), format!("{}\n", body.trim_end())))
        .collect())
}

impl Names<'_> {
    /// A struct with its constants and its default. `typed` follows its name in the text; `what`
    /// begins its documentation if the file has none: "A message".
    fn item(
        &self,
        body: &mut String,
        interface: &Interface,
        part: &Part,
        name: &str,
        (typed, what): (&str, &str),
    ) -> Result<(), GenerateError> {
        let path = format!("{}/{}", interface.package, interface.name);
        let (mut is_copy, mut derives_default) = (true, true);
        let (mut fields, mut defaults) = (String::new(), String::new());
        for field in &part.fields {
            let refused = |what| interface.refused(field.line, what);
            let (text, copy) = self.of(interface, &field.kind).map_err(refused)?;
            is_copy &= copy;
            let identifier = identifier(&field.name);
            let fallback = format!("`{}`.", field.name);
            doc(&mut fields, "        ", &field.doc, &fallback);
            if matches!(field.kind.count, Count::Exactly(33..)) {
                fields.push_str("        #[serde(with = \"luna_ros2::big_array\")]\n");
                derives_default = false;
            }
            derives_default &= field.value.is_none();
            let _ = writeln!(fields, "        pub {identifier}: {text},");
            let value = default(field).map_err(refused)?;
            let _ = writeln!(defaults, "            {identifier}: {value},");
        }
        if part.fields.is_empty() {
            // As ROS 2 does: a structure of DDS has a member.
            let member = "structure_needs_at_least_one_member";
            let doc = "        /// Without meaning.\n";
            let _ = writeln!(fields, "{doc}        pub {member}: u8,");
        }
        let _ = writeln!(body, "luna_ros2::message! {{");
        doc(body, "    ", &part.doc, &format!("{what} of `{path}`."));
        let derived = match (is_copy, derives_default) {
            (true, true) => "    #[derive(Copy, Default)]\n",
            (true, false) => "    #[derive(Copy)]\n",
            (false, true) => "    #[derive(Default)]\n",
            (false, false) => "",
        };
        let _ = write!(
            body,
            "{derived}    pub struct {name}{typed} {{\n{fields}    }}\n}}\n"
        );
        if !part.constants.is_empty() {
            let _ = writeln!(body, "\nimpl {name} {{");
            for constant in &part.constants {
                let refused = |what| interface.refused(constant.line, what);
                let value = constant.value.as_deref().unwrap_or_default();
                let (text, value) = match &constant.kind.base {
                    Base::Text(_) => ("&'static str", format!("{:?}", unquoted(value))),
                    Base::Plain(plain) => (*plain, literal(plain, value).map_err(refused)?),
                    Base::Named { .. } => continue,
                };
                let fallback = format!("`{}`.", constant.name);
                doc(body, "    ", &constant.doc, &fallback);
                let _ = writeln!(body, "    pub const {}: {text} = {value};", constant.name);
            }
            body.push_str("}\n");
        }
        if !derives_default {
            let _ = write!(
                body,
                "\n#[allow(clippy::derivable_impls, reason = \"generated\")]\nimpl Default for {name} {{\n    fn default() -> Self {{\n        Self {{\n{defaults}        }}\n    }}\n}}\n"
            );
        }
        Ok(())
    }

    /// A type in Rust, and whether it is `Copy`.
    fn of(&self, interface: &Interface, kind: &Type) -> Result<(String, bool), String> {
        let (base, copy) = match &kind.base {
            Base::Plain(plain) => ((*plain).to_owned(), true),
            Base::Text(None) => ("std::string::String".to_owned(), false),
            Base::Text(Some(bound)) => (format!("luna_ros2::arrayvec::ArrayString<{bound}>"), true),
            Base::Named { package, name } => self.named(interface, package, name)?,
        };
        Ok(match kind.count {
            Count::One => (base, copy),
            Count::Exactly(count) => (format!("[{base}; {count}]"), copy),
            Count::AtMost(bound) => (
                format!("luna_ros2::arrayvec::ArrayVec<{base}, {bound}>"),
                false,
            ),
            Count::Any => (format!("Vec<{base}>"), false),
        })
    }

    fn named(
        &self,
        interface: &Interface,
        package: &str,
        name: &str,
    ) -> Result<(String, bool), String> {
        // ROS 2 knows it without its package.
        let package = match name {
            "Header" if !self.own.contains_key(&(package, name)) => "std_msgs",
            _ => package,
        };
        if let Some(found) = self.own.get(&(package, name)) {
            let path = match package == interface.package {
                true => name.to_owned(),
                false => format!("super::{package}::{name}"),
            };
            return Ok((path, self.is_copy(found, 0)?));
        }
        let known = KNOWN
            .iter()
            .find(|known| (known.0, known.1) == (package, name));
        known
            .map(|known| (format!("luna_ros2::msg::{package}::{name}"), known.2))
            .ok_or_else(|| {
                format!("there is no `{package}/{name}`: put its file into the folder, as {package}/msg/{name}.msg")
            })
    }

    fn is_copy(&self, interface: &Interface, depth: usize) -> Result<bool, String> {
        let name = &interface.name;
        if depth > 30 {
            return Err(format!("`{name}` contains itself"));
        }
        let Parts::Message(part) = &interface.parts else {
            return Ok(false);
        };
        let mut is_copy = true;
        for field in &part.fields {
            let inner = match &field.kind.base {
                Base::Named { package, name } => {
                    match self.own.get(&(package.as_str(), name.as_str())) {
                        Some(inner) => self.is_copy(inner, depth + 1)?,
                        None => self.named(interface, package, name)?.1,
                    }
                }
                Base::Text(None) => false,
                _ => true,
            };
            is_copy &= inner && matches!(field.kind.count, Count::One | Count::Exactly(_));
        }
        Ok(is_copy)
    }
}

fn default(field: &Member) -> Result<String, String> {
    let Type { base, count } = &field.kind;
    let Some(value) = &field.value else {
        return Ok(match count {
            Count::Exactly(_) => "std::array::from_fn(|_| Default::default())".to_owned(),
            _ => "Default::default()".to_owned(),
        });
    };
    let one = |value: &str| match base {
        Base::Plain(plain) => literal(plain, value),
        Base::Text(None) => Ok(format!("{:?}.to_owned()", unquoted(value))),
        Base::Text(Some(bound)) if unquoted(value).len() <= *bound => Ok(format!(
            "luna_ros2::arrayvec::ArrayString::from({:?}).unwrap_or_default()",
            unquoted(value)
        )),
        Base::Text(Some(_)) => Err(format!("{value} is longer than its bound")),
        Base::Named { .. } => Err("a message has no default".to_owned()),
    };
    if *count == Count::One {
        return one(value);
    }
    let inner = value
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .ok_or_else(|| format!("the default {value} is no list; write [1, 2]"))?;
    if matches!(base, Base::Text(_)) && inner.contains(['\'', '"']) {
        return Err("a default of a list of strings has no type here; leave it out".to_owned());
    }
    let values = inner
        .split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty());
    let values = values.map(one).collect::<Result<Vec<_>, _>>()?;
    let length = values.len();
    let list = values.join(", ");
    match count {
        Count::Exactly(count) if *count == length => Ok(format!("[{list}]")),
        Count::Exactly(count) => Err(format!("the default has {length} elements, not {count}")),
        Count::AtMost(bound) if length > *bound => Err(format!(
            "the default has {length} elements, more than {bound}"
        )),
        Count::AtMost(_) => Ok(format!("[{list}].into_iter().collect()")),
        _ => Ok(format!("vec![{list}]")),
    }
}

/// A number or bool as Rust writes it, checked by its type.
fn literal(plain: &str, value: &str) -> Result<String, String> {
    let wrong = || format!("`{value}` is no `{plain}`");
    let whole = |least: i128, most: i128| {
        let parsed = match value.strip_prefix("0x") {
            Some(digits) => i128::from_str_radix(digits, 16),
            None => value.parse::<i128>(),
        };
        match parsed {
            Ok(number) if (least..=most).contains(&number) => Ok(number.to_string()),
            _ => Err(wrong()),
        }
    };
    match plain {
        "bool" => match value {
            "true" | "True" | "1" => Ok("true".to_owned()),
            "false" | "False" | "0" => Ok("false".to_owned()),
            _ => Err(wrong()),
        },
        "i8" => whole(i8::MIN.into(), i8::MAX.into()),
        "u8" => whole(0, u8::MAX.into()),
        "i16" => whole(i16::MIN.into(), i16::MAX.into()),
        "u16" => whole(0, u16::MAX.into()),
        "i32" => whole(i32::MIN.into(), i32::MAX.into()),
        "u32" => whole(0, u32::MAX.into()),
        "i64" => whole(i64::MIN.into(), i64::MAX.into()),
        "u64" => whole(0, u64::MAX.into()),
        _ => match value.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(format!("{number:?}")),
            _ => Err(wrong()),
        },
    }
}

fn unquoted(value: &str) -> &str {
    ['"', '\'']
        .into_iter()
        .find_map(|quote| value.strip_prefix(quote)?.strip_suffix(quote))
        .unwrap_or(value)
}

/// The comments of the file, or else a few words.
fn doc(text: &mut String, indent: &str, lines: &[String], fallback: &str) {
    if lines.iter().all(String::is_empty) {
        let _ = writeln!(text, "{indent}/// {fallback}");
    }
    for line in lines.iter().filter(|line| !line.is_empty()) {
        // Brackets would be links.
        let line = line
            .replace('[', "\\[")
            .replace(']', "\\]")
            .replace('<', "\\<");
        let _ = writeln!(text, "{indent}/// {line}");
    }
}

/// A name that is a word of Rust's is written raw.
fn identifier(name: &str) -> String {
    const WORDS: &[&str] = &[
        "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do",
        "dyn", "else", "enum", "extern", "final", "fn", "for", "gen", "if", "impl", "in", "let",
        "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "return",
        "static", "struct", "trait", "try", "type", "typeof", "unsafe", "unsized", "use",
        "virtual", "where", "while", "yield", "true", "false",
    ];
    match name {
        // These cannot be raw.
        "self" | "super" | "crate" => format!("{name}_"),
        _ if WORDS.contains(&name) => format!("r#{name}"),
        _ => name.to_owned(),
    }
}
