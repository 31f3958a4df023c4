//! The types of fields.

/// What one element of a field is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Base {
    /// A number or `bool`, by its name in Rust.
    Plain(&'static str),
    /// With its bound in bytes, if it has one.
    Text(Option<usize>),
    /// A message of a package; of the own one if none is named.
    Named { package: String, name: String },
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Count {
    One,
    Exactly(usize),
    AtMost(usize),
    Any,
}

/// The type of a field or constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Type {
    pub(super) base: Base,
    pub(super) count: Count,
}

impl Type {
    /// # Errors
    ///
    /// What is wrong about it.
    pub(super) fn parse(text: &str, package: &str) -> Result<Self, String> {
        let (base, count) = match text.strip_suffix(']') {
            None => (text, Count::One),
            Some(rest) => {
                let (base, inner) = rest
                    .rsplit_once('[')
                    .ok_or_else(|| format!("`{text}` has a `]` without a `[`"))?;
                let count = match inner.strip_prefix("<=") {
                    _ if inner.is_empty() => Count::Any,
                    Some(bound) => Count::AtMost(number(bound, text)?),
                    None => Count::Exactly(number(inner, text)?),
                };
                (base, count)
            }
        };
        let base = Self::base(base, text, package)?;
        Ok(Self { base, count })
    }

    fn base(base: &str, text: &str, package: &str) -> Result<Base, String> {
        let (name, bound) = match base.split_once("<=") {
            Some((name, bound)) => (name, Some(number(bound, text)?)),
            None => (base, None),
        };
        let plain = match name {
            "bool" => "bool",
            "byte" | "char" | "uint8" => "u8",
            "int8" => "i8",
            "int16" => "i16",
            "uint16" => "u16",
            "int32" => "i32",
            "uint32" => "u32",
            "int64" => "i64",
            "uint64" => "u64",
            "float32" => "f32",
            "float64" => "f64",
            "string" => return Ok(Base::Text(bound)),
            "wstring" => return Err("`wstring` has no type here; use `string`".to_owned()),
            _ => "",
        };
        if bound.is_some() {
            return Err(format!("`{text}`: only strings and lists have a bound"));
        }
        if !plain.is_empty() {
            return Ok(Base::Plain(plain));
        }
        let parts: Vec<&str> = name.split('/').collect();
        let (package, name) = match parts[..] {
            [name] => (package, name),
            [package, name] | [package, "msg", name] => (package, name),
            _ => return Err(format!("`{text}` is no type; write PACKAGE/NAME")),
        };
        if !is_package_name(package) || !is_type_name(name) {
            return Err(format!(
                "`{text}` is no type of ROS 2; a message's name begins with a capital"
            ));
        }
        Ok(Base::Named {
            package: package.to_owned(),
            name: name.to_owned(),
        })
    }

    /// Whether a constant may have it.
    pub(super) fn is_constant(&self) -> bool {
        self.count == Count::One && matches!(self.base, Base::Plain(_) | Base::Text(_))
    }
}

fn number(text: &str, whole: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if number > 0 => Ok(number),
        _ => Err(format!(
            "`{whole}`: the number of elements must be a whole number from 1"
        )),
    }
}

pub(super) fn is_type_name(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_uppercase())
        && name.chars().all(|letter| letter.is_ascii_alphanumeric())
}

/// Of packages and fields alike.
pub(super) fn is_package_name(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name
            .chars()
            .all(|letter| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_')
}
