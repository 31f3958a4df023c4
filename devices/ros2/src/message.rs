//! What goes over topics and services.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::DeserializeOwned};

/// A message: a type of ROS 2 with its name there.
///
/// Its fields are encoded in their order, as in the `.msg` file: a struct of numbers, `String`,
/// `Vec`, arrays and other messages. With [`arrayvec`](crate::arrayvec) in place of `String` and
/// `Vec` a message has no heap, so that a process on the real-time path may make and drop it.
///
/// [`message!`](crate::message!) defines one, [`msg`](crate::msg) has the usual ones, and
/// [`generate`](crate::generate) makes them from `.msg` files.
pub trait Message: Payload {
    /// As `PACKAGE/msg/NAME`.
    const TYPE: &'static str;
}

/// A service: the types of its request and its reply.
///
/// ```
/// use luna_ros2::{Service, message};
///
/// message! {
///     /// Two numbers.
///     pub struct Two { pub a: i64, pub b: i64 }
/// }
/// message! {
///     /// Their sum.
///     pub struct Sum { pub sum: i64 }
/// }
/// enum AddTwoInts {}
/// impl Service for AddTwoInts {
///     type Request = Two;
///     type Reply = Sum;
///     const TYPE: &'static str = "example_interfaces/srv/AddTwoInts";
/// }
/// ```
pub trait Service: 'static {
    /// What a client asks.
    type Request: Payload;
    /// What the server answers.
    type Reply: Payload;
    /// As `PACKAGE/srv/NAME`.
    const TYPE: &'static str;
}

/// What can be encoded: every type that has these traits.
pub trait Payload: Serialize + DeserializeOwned + Clone + Send + 'static {}

impl<T: Serialize + DeserializeOwned + Clone + Send + 'static> Payload for T {}

/// Defines a message, or with no name a part of one.
///
/// ```
/// luna_ros2::message! {
///     /// A level in a tank.
///     #[derive(Copy, Default)]
///     pub struct Level: "tank_msgs/msg/Level" {
///         /// In metres.
///         pub metres: f64,
///         pub is_full: bool,
///     }
/// }
/// assert_eq!(<Level as luna_ros2::Message>::TYPE, "tank_msgs/msg/Level");
/// ```
#[macro_export]
macro_rules! message {
    ($(#[$meta:meta])* $seen:vis struct $name:ident $(: $path:literal)? { $($fields:tt)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        #[derive($crate::serde::Serialize, $crate::serde::Deserialize)]
        #[serde(crate = "luna_ros2::serde")]
        $seen struct $name { $($fields)* }

        $(impl $crate::Message for $name {
            const TYPE: &'static str = $path;
        })?
    };
}

/// A payload as ros2-client wants it.
#[derive(Debug, Clone)]
pub(crate) struct Wire<T>(pub(crate) T);

impl<T: Payload> ros2_client::Message for Wire<T> {}

impl<T: Serialize> Serialize for Wire<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Wire<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        T::deserialize(deserializer).map(Wire)
    }
}

/// Arrays of more than 32 elements: `#[serde(with = "luna_ros2::big_array")]`.
///
/// ```
/// luna_ros2::message! {
///     /// With a field of 36 numbers.
///     pub struct Covariance {
///         #[serde(with = "luna_ros2::big_array")]
///         pub rows: [f64; 36],
///     }
/// }
/// ```
pub mod big_array {
    use arrayvec::ArrayVec;
    use serde::de::{Error, SeqAccess, Visitor};
    use serde::ser::SerializeTuple;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::fmt;
    use std::marker::PhantomData;

    /// Encodes an array without its length, as all arrays.
    ///
    /// # Errors
    ///
    /// Those of the serializer.
    pub fn serialize<S: Serializer, T: Serialize, const N: usize>(
        array: &[T; N],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(N)?;
        for element in array {
            tuple.serialize_element(element)?;
        }
        tuple.end()
    }

    /// Decodes it.
    ///
    /// # Errors
    ///
    /// Those of the deserializer, or too few elements.
    pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<[T; N], D::Error> {
        struct Elements<T, const N: usize>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Elements<T, N> {
            type Value = [T; N];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{N} elements")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<[T; N], A::Error> {
                let mut array = ArrayVec::<T, N>::new();
                while !array.is_full() {
                    match list.next_element()? {
                        Some(element) => array.push(element),
                        None => return Err(A::Error::invalid_length(array.len(), &self)),
                    }
                }
                array
                    .into_inner()
                    .map_err(|array| A::Error::invalid_length(array.len(), &self))
            }
        }
        deserializer.deserialize_tuple(N, Elements(PhantomData))
    }
}
