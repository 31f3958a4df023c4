//! What goes into a plant and comes out of it: names, units, ranges.

use std::fmt;
use std::sync::Arc;

/// What happens to a value outside of its port's range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outside {
    /// It becomes the nearer end of the range, as with a bridge at its supply or a converter at
    /// full scale. Infinities saturate too; a NaN never does.
    Saturate,
    /// It is a failure of the plant: [`PlantError::OutOfRange`](crate::PlantError::OutOfRange).
    Fail,
}

/// An input or output of a plant.
///
/// ```
/// use luna_plants::{Outside, Port};
///
/// let duty = Port::new("duty", "1").range(-1.0, 1.0).outside(Outside::Saturate);
/// assert_eq!(duty.to_string(), "duty in 1, -1 to 1, saturates");
/// assert_eq!(Port::new("angle", "rad").to_string(), "angle in rad");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    name: Arc<str>,
    unit: Arc<str>,
    min: f64,
    max: f64,
    outside: Outside,
}

impl Port {
    /// A port called `name` with values in `unit` ("rad", "1" for a ratio). Any finite value is
    /// allowed; another is a failure of the plant.
    pub fn new(name: &str, unit: &str) -> Port {
        Port {
            name: Arc::from(name),
            unit: Arc::from(unit),
            min: f64::NEG_INFINITY,
            max: f64::INFINITY,
            outside: Outside::Fail,
        }
    }

    /// With values of `min` to `max`, both included.
    ///
    /// # Panics
    ///
    /// If `min` is above `max`, or one of them is not a number.
    #[must_use]
    #[track_caller]
    pub fn range(mut self, min: f64, max: f64) -> Port {
        assert!(
            min <= max,
            "`{}` has no range from {min} to {max}",
            self.name
        );
        (self.min, self.max) = (min, max);
        self
    }

    /// With values outside of the range treated like this.
    #[must_use]
    pub fn outside(mut self, outside: Outside) -> Port {
        self.outside = outside;
        self
    }

    /// What it is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What its values are in.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// The least value, in its unit; negative infinity if unlimited.
    pub fn min(&self) -> f64 {
        self.min
    }

    /// The greatest value, in its unit; infinity if unlimited.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// What happens to others.
    pub fn on_outside(&self) -> Outside {
        self.outside
    }

    pub(crate) fn shared_name(&self) -> Arc<str> {
        self.name.clone()
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in {}", self.name, self.unit)?;
        if self.min > f64::NEG_INFINITY || self.max < f64::INFINITY {
            write!(f, ", {} to {}", self.min, self.max)?;
            if self.outside == Outside::Saturate {
                f.write_str(", saturates")?;
            }
        }
        Ok(())
    }
}
