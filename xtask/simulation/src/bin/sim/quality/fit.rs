//! Least squares over the crossings of a window, with polynomials that are orthogonal on them.
//!
//! The leading coefficient of a polynomial of degree m, fitted to any points, is a mean of the
//! divided differences of order m with positive weights. So m! times the coefficient is a mean of the
//! m-th derivative over the window. Without noise, the mean never exceeds the maximum of the
//! derivative.

/// A position at a time. The position is exact, the time is not: a step is due when the axis is
/// midway between two steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Time, s.
    pub(super) seconds: f64,
    /// Position in steps, or mm along the path.
    pub(super) position: f64,
    /// Standard deviation of the time, s.
    pub(super) grain_s: f64,
    /// Limits of acceleration and jerk at the time, mm/s² and mm/s³.
    pub(super) limit: [f64; 2],
}

/// Highest degree of a fit.
const DEGREE: usize = 3;

/// A polynomial fitted to a window, and a basis that is orthogonal on it.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    degree: usize,
    /// Middle and half length of the window, s.
    middle_s: f64,
    half_s: f64,
    /// Recurrence p(k+1) = (x - a(k))·p(k) - b(k)·p(k-1), and the sum of squares of each polynomial.
    shift: [f64; DEGREE + 1],
    weight: [f64; DEGREE + 1],
    squares: [f64; DEGREE + 1],
    coefficients: [f64; DEGREE + 1],
    /// Position that is subtracted from all positions.
    origin: f64,
}

impl Fit {
    /// Fits a polynomial of up to the third degree to more points than the degree.
    pub(super) fn new<'a, P>(points: &P, degree: usize) -> Option<Self>
    where
        P: DoubleEndedIterator<Item = &'a Crossing> + Clone,
    {
        let (first, last) = (points.clone().next()?, points.clone().next_back()?);
        let mut fit = Self {
            degree: degree.min(DEGREE),
            middle_s: f64::midpoint(first.seconds, last.seconds),
            half_s: (last.seconds - first.seconds) / 2.0,
            shift: [0.0; DEGREE + 1],
            weight: [0.0; DEGREE + 1],
            squares: [0.0; DEGREE + 1],
            coefficients: [0.0; DEGREE + 1],
            origin: first.position,
        };
        if fit.half_s <= 0.0 {
            return None;
        }
        for order in 0..=fit.degree {
            let [mut squares, mut moments, mut product] = [0.0; 3];
            for point in points.clone() {
                let x = fit.scaled(point.seconds);
                let value = fit.polynomials(x)[order];
                squares += value * value;
                moments += x * value * value;
                product += value * (point.position - fit.origin);
            }
            if squares < 1.0e-9 {
                return None;
            }
            fit.squares[order] = squares;
            fit.shift[order] = moments / squares;
            fit.coefficients[order] = product / squares;
            if order > 0 {
                fit.weight[order] = squares / fit.squares[order - 1];
            }
        }
        Some(fit)
    }

    fn scaled(&self, seconds: f64) -> f64 {
        (seconds - self.middle_s) / self.half_s
    }

    /// The known part of the basis at a place of the window, -1 to 1.
    fn polynomials(&self, x: f64) -> [f64; DEGREE + 1] {
        let mut values = [1.0; DEGREE + 1];
        for order in 1..=self.degree {
            let before = if order > 1 { values[order - 2] } else { 0.0 };
            values[order] =
                (x - self.shift[order - 1]) * values[order - 1] - self.weight[order - 1] * before;
        }
        values
    }

    /// The m-th derivative of a fit of degree m for a leading coefficient of 1, 1/s to the power m.
    fn scale(&self) -> f64 {
        let factors = (1..=self.degree).map(|order| order as f64 / self.half_s);
        factors.product()
    }

    /// The m-th derivative of a fit of degree m, a mean over the window, 1/s to the power m.
    pub(super) fn leading(&self) -> f64 {
        self.coefficients[self.degree] * self.scale()
    }

    /// The standard deviation of [`Self::leading`] for the standard deviation of a position.
    pub(super) fn leading_noise(&self, position: f64) -> f64 {
        position * self.scale() / self.squares[self.degree].sqrt()
    }

    /// Position at a time.
    pub(super) fn position(&self, seconds: f64) -> f64 {
        let values = self.polynomials(self.scaled(seconds));
        let terms = values.iter().zip(&self.coefficients);
        self.origin + terms.map(|(value, factor)| value * factor).sum::<f64>()
    }

    /// Speed at a time, 1/s.
    pub(super) fn speed(&self, seconds: f64) -> f64 {
        let x = self.scaled(seconds);
        let values = self.polynomials(x);
        let mut slopes = [0.0; DEGREE + 1];
        for order in 1..=self.degree {
            let before = if order > 1 { slopes[order - 2] } else { 0.0 };
            slopes[order] = values[order - 1] + (x - self.shift[order - 1]) * slopes[order - 1]
                - self.weight[order - 1] * before;
        }
        let terms = slopes.iter().zip(&self.coefficients);
        terms.map(|(slope, factor)| slope * factor).sum::<f64>() / self.half_s
    }

    /// The jump of the speed in the middle of the window and the standard deviation of the jump, 1/s.
    ///
    /// The jump is the component of the points along |t| that is orthogonal to the polynomial.
    pub(super) fn jump<'a>(
        &self,
        points: impl Iterator<Item = &'a Crossing> + Clone,
        noise: f64,
    ) -> (f64, f64) {
        let mut shares = [0.0; DEGREE + 1];
        for point in points.clone() {
            let x = self.scaled(point.seconds);
            for (share, value) in shares.iter_mut().zip(self.polynomials(x)) {
                *share += x.abs() * value;
            }
        }
        for (share, squares) in shares.iter_mut().zip(self.squares).take(self.degree + 1) {
            *share /= squares;
        }
        let [mut squares, mut product] = [0.0; 2];
        for point in points {
            let x = self.scaled(point.seconds);
            let values = self.polynomials(x);
            let like: f64 = (0..=self.degree).map(|n| shares[n] * values[n]).sum();
            let residual = x.abs() - like;
            squares += residual * residual;
            product += residual * (point.position - self.origin);
        }
        if squares < 1.0e-9 {
            return (0.0, f64::INFINITY);
        }
        let scale = 2.0 / self.half_s;
        (product / squares * scale, noise * scale / squares.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(position: impl Fn(f64) -> f64) -> Vec<Crossing> {
        // Uneven, as step times are.
        let times = (0..40).map(|n| 0.001 * (f64::from(n) + 0.3 * f64::from(n % 3)));
        let crossing = |seconds| Crossing {
            seconds,
            position: position(seconds),
            grain_s: 0.0,
            limit: [1.0; 2],
        };
        times.map(crossing).collect()
    }

    #[test]
    fn a_cubic_is_found_exactly() {
        let cubic = |t: f64| 5.0 + 30.0 * t - 400.0 * t * t + 9000.0 * t * t * t;
        let fit = Fit::new(&points(cubic).iter(), 3).unwrap();
        assert!((fit.leading() - 54_000.0).abs() < 1.0e-3);
        assert!((fit.position(0.0123) - cubic(0.0123)).abs() < 1.0e-9);
        assert!((fit.speed(0.01) - (30.0 - 8.0 + 2.7)).abs() < 1.0e-7);
    }

    #[test]
    fn a_leading_coefficient_never_exceeds_the_derivative() {
        // Acceleration between 0 and 600.
        let ramp = |t: f64| {
            if t < 0.02 {
                0.0
            } else {
                300.0 * (t - 0.02).powi(2)
            }
        };
        let points = points(ramp);
        for length in 4..points.len() {
            for window in points.windows(length) {
                let second = Fit::new(&window.iter(), 2).unwrap().leading();
                assert!((-1.0e-6..=600.0 + 1.0e-6).contains(&second), "{second}");
            }
        }
    }

    #[test]
    fn a_jump_is_found_and_an_acceleration_is_none() {
        let points = points(|t| 50.0 * t + 1000.0 * t * t + 7.0 * (t - 0.0195).max(0.0));
        let fit = Fit::new(&points.iter(), 2).unwrap();
        let (jump, noise) = fit.jump(points.iter(), 1.0e-6);
        assert!((jump - 7.0).abs() < 0.05, "{jump}");
        assert!(noise > 0.0 && noise < 0.01, "{noise}");
    }
}
