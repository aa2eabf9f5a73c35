//! Profiles that motion is compared with, and by how much step times miss them.

/// The exact trapezoid of a move from rest to rest.
pub(crate) struct Trapezoid {
    pub(crate) length: f64,
    pub(crate) speed: f64,
    pub(crate) acceleration: f64,
}

impl Trapezoid {
    pub(crate) fn seconds(&self) -> f64 {
        self.length / self.speed + self.speed / self.acceleration
    }

    /// Way after a time.
    pub(crate) fn distance(&self, seconds: f64) -> f64 {
        let (end, ramp) = (self.seconds(), self.speed / self.acceleration);
        let ramped = |t: f64| 0.5 * self.acceleration * t.clamp(0.0, ramp).powi(2);
        let cruised = self.speed * (seconds - ramp).clamp(0.0, end - 2.0 * ramp);
        ramped(seconds) + cruised + ramped(ramp) - ramped(end - seconds.clamp(end - ramp, end))
    }

    /// Time at which a distance is reached, s.
    pub(crate) fn when(&self, distance: f64) -> f64 {
        let ramp = self.speed * self.speed / (2.0 * self.acceleration);
        if distance <= ramp {
            (2.0 * distance / self.acceleration).sqrt()
        } else if distance <= self.length - ramp {
            self.speed / self.acceleration + (distance - ramp) / self.speed
        } else {
            self.seconds() - (2.0 * (self.length - distance).max(0.0) / self.acceleration).sqrt()
        }
    }
}

/// RMS of the error of the intervals between steps, relative to the exact interval.
pub(crate) fn interval_error_rms(times: &[f64], exact: &[f64]) -> f64 {
    let errors = times.windows(2).zip(exact.windows(2)).map(|(real, ideal)| {
        let interval = ideal[1] - ideal[0];
        ((real[1] - real[0]) - interval) / interval
    });
    (errors.map(|error| error * error).sum::<f64>() / (times.len() - 1) as f64).sqrt()
}
