//! What the processes send each other. All is plain data without references.

use crate::parameters::{AXES, PIXELS};

/// How many exposures safety remembers: more than vision takes time for.
pub const EXPOSURES: usize = 8;

/// What the hardware's registers have: from the simulated machine, for safety.
#[derive(Debug, Clone, Copy, Default)]
pub struct Readings {
    /// The encoders' counters.
    pub counts: [i32; AXES],
    /// Since the start, in s.
    pub time: f64,
    /// The number of the newest image: its trigger line goes to the counter card, too.
    pub image: u32,
}

/// Where the head was when an image was exposed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Exposure {
    /// The number of the image; 0 is none.
    pub image: u32,
    /// When, in s since the start.
    pub time: f64,
    /// The joints.
    pub angles: [f64; AXES],
}

/// The readings that safety has checked, for the controllers.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// Since the start, in s.
    pub time: f64,
    /// The joints.
    pub angles: [f64; AXES],
    /// The newest exposures, the last one at its number modulo their count.
    pub exposures: [Exposure; EXPOSURES],
}

/// Motion control to the joint controllers.
#[derive(Debug, Clone, Copy, Default)]
pub struct SetPoint {
    /// When it begins, in s since the start.
    pub time: f64,
    /// Where the joints are to be then.
    pub angles: [f64; AXES],
    /// How fast they are to be from then on, in rad/s.
    pub rates: [f64; AXES],
}

/// Safety to the motors.
#[derive(Debug, Clone, Copy, Default)]
pub struct Drive {
    /// −1 to 1 of the supply.
    pub duties: [f64; AXES],
    /// Whether safety has stopped the head.
    pub is_stopped: bool,
}

/// The grey values of one camera, line by line.
pub type Pixels = [u8; PIXELS[0] * PIXELS[1]];

luna_links::cycle_data! {
    /// What the cameras send to vision.
    #[derive(Clone, Copy)]
    pub struct Image: "head/image", version 1 {
        /// Its number, from 1.
        pub number: u32,
        /// Of the left and the right eye.
        pub eyes: [Pixels; 2],
    }
}

impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Image")
            .field("number", &self.number)
            .finish_non_exhaustive()
    }
}

luna_links::cycle_data! {
    /// What vision has found in an image.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Sighting: "head/sighting", version 1 {
        /// The number of the image.
        pub image: u32,
        /// Where the target is for the left and the right eye: tangents of the angles to the left
        /// and up, from the optical axis.
        pub eyes: [[f64; 2]; 2],
    }
}
