//! Parameters of the ICR models.

/// Positions of the tread ICRs on level ground (ICRHK), in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizontalIcrs {
    /// Left tread's ICR to the right of the origin, m; negative.
    pub left_m: f64,
    /// Right tread's ICR to the right of the origin, m; positive.
    pub right_m: f64,
    /// Both treads' ICR ahead of the origin, m.
    pub forward_m: f64,
}

/// Parameters of ICRIK: how far the tread ICRs move on a slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlideGains {
    /// lambda_1, s/rad: shift of all ICRs with roll and pitch.
    pub shift_s_per_rad: f64,
    /// lambda_2, s/rad: extra shift of one tread when pointing mostly up or down.
    pub aggravated_s_per_rad: f64,
}
