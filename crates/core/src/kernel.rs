//! Robust kernels.

/// How the cost of a residual grows; `s` is the squared whitened residual, k the threshold in sigmas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// ρ(s) = s.
    Squared,
    /// Quadratic up to k, linear beyond (Huber 1964).
    Huber(f64),
    /// ρ(s) = k² log(1 + s/k²).
    Cauchy(f64),
    /// ρ(s) = s / (1 + s/k²): bounded by k² (Geman and McClure 1985).
    GemanMcClure(f64),
}

impl Kernel {
    /// ρ(s).
    #[must_use]
    pub fn loss(&self, s: f64) -> f64 {
        match *self {
            Self::Squared => s,
            Self::Huber(k) if s <= k * k => s,
            Self::Huber(k) => 2.0 * k * s.sqrt() - k * k,
            Self::Cauchy(k) => k * k * (s / (k * k)).ln_1p(),
            Self::GemanMcClure(k) => s / (1.0 + s / (k * k)),
        }
    }

    /// ρ′(s): the weight of a row in iteratively reweighted least squares.
    #[must_use]
    pub fn weight(&self, s: f64) -> f64 {
        match *self {
            Self::Squared => 1.0,
            Self::Huber(k) if s <= k * k => 1.0,
            Self::Huber(k) => k / s.sqrt(),
            Self::Cauchy(k) => 1.0 / (1.0 + s / (k * k)),
            Self::GemanMcClure(k) => (1.0 + s / (k * k)).powi(-2),
        }
    }
}
