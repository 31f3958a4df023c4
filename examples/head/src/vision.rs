//! The cameras and vision. A camera draws what it sees; vision looks for the target in that. The
//! thesis has vision on a computer of its own that is not real-time.

use crate::kinematics::Eye;
use crate::messages::{Image, Pixels, Sighting};
use crate::parameters::{FOCAL, PIXELS};
use nalgebra::Vector3;

/// How large the target appears, in pixels: the standard deviation of its brightness.
const SPREAD: f64 = 1.6;
const BRIGHTNESS: f64 = 220.0;
/// The background's grey values are below this.
const NOISE: u32 = 6;
/// Pixels above this are the target's.
const THRESHOLD: u8 = 30;
/// So many of them at least, or it was not found.
const FEWEST: usize = 6;

/// Grey values without a target, of a generator with the same numbers in each run.
#[derive(Debug, Clone)]
pub struct Camera {
    noise: u32,
}

impl Default for Camera {
    fn default() -> Self {
        Self { noise: 0x9e37_79b9 }
    }
}

impl Camera {
    /// What `eye` sees of a target at `point`.
    pub fn expose(&mut self, eye: &Eye, point: &Vector3<f64>) -> Pixels {
        let mut pixels = [0; PIXELS[0] * PIXELS[1]];
        for pixel in &mut pixels {
            // Marsaglia's xorshift.
            self.noise ^= self.noise << 13;
            self.noise ^= self.noise >> 17;
            self.noise ^= self.noise << 5;
            *pixel = (self.noise % NOISE) as u8;
        }
        let Some([left, up]) = eye.image(point) else {
            return pixels;
        };
        let centre = [-left, -up].map(|tangent| tangent * FOCAL);
        let reach = (4.0 * SPREAD).ceil();
        for (n, pixel) in pixels.iter_mut().enumerate() {
            let at = place(n);
            let [dx, dy] = [at[0] - centre[0], at[1] - centre[1]];
            if dx.abs() < reach && dy.abs() < reach {
                let bright = BRIGHTNESS * (-(dx * dx + dy * dy) / (2.0 * SPREAD * SPREAD)).exp();
                *pixel += bright as u8;
            }
        }
        pixels
    }
}

/// Where the pixel of this number is: right of and below the middle, in pixels.
fn place(n: usize) -> [f64; 2] {
    let at = [n % PIXELS[0], n / PIXELS[0]];
    [0, 1].map(|axis| at[axis] as f64 - (PIXELS[axis] - 1) as f64 / 2.0)
}

/// Looks for the target in both images; none if one of them does not have it.
pub fn find(image: &Image) -> Option<Sighting> {
    let [left, right] = [0, 1].map(|eye| centre(&image.eyes[eye]));
    Some(Sighting {
        image: image.number,
        eyes: [left?, right?],
    })
}

/// The centre of what is bright.
fn centre(pixels: &Pixels) -> Option<[f64; 2]> {
    let (mut sum, mut sums, mut count) = (0.0, [0.0; 2], 0);
    for (n, pixel) in pixels.iter().enumerate() {
        if *pixel > THRESHOLD {
            let weight = f64::from(*pixel);
            let at = place(n);
            sum += weight;
            sums[0] += weight * at[0];
            sums[1] += weight * at[1];
            count += 1;
        }
    }
    (count >= FEWEST).then(|| sums.map(|part| -part / sum / FOCAL))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::Pose;
    use crate::parameters::AXES;

    fn image(point: &Vector3<f64>) -> Image {
        let pose = Pose::new(&[0.0; AXES]);
        let mut camera = Camera::default();
        Image {
            number: 7,
            eyes: pose.eyes.map(|eye| camera.expose(&eye, point)),
        }
    }

    #[test]
    fn the_target_is_found_to_a_fraction_of_a_pixel() {
        for point in [[1.0, 0.1, 0.3], [1.3, -0.4, 0.1], [0.8, 0.0, 0.19]] {
            let point = Vector3::from(point);
            let sighting = find(&image(&point)).unwrap();
            assert_eq!(sighting.image, 7);
            let pose = Pose::new(&[0.0; AXES]);
            for (eye, found) in pose.eyes.iter().zip(sighting.eyes) {
                let true_place = eye.image(&point).unwrap();
                for axis in [0, 1] {
                    let error = (found[axis] - true_place[axis]) * FOCAL;
                    assert!(error.abs() < 0.1, "{point:?}: {error} pixels");
                }
            }
        }
    }

    #[test]
    fn what_is_not_in_both_images_is_not_found() {
        for point in [[-1.0, 0.0, 0.2], [1.0, 1.0, 0.2], [1.0, 0.0, 1.5]] {
            assert_eq!(find(&image(&Vector3::from(point))), None);
        }
    }
}
