//! The policy: an intelligent driver (Treiber et al. 2000) that follows what its lidar sees ahead in its lane.

use crate::messages::{EgoState, Lidar};
use std::f64::consts::PI;

const DESIRED_SPEED_MPS: f64 = 24.6;
const HEADWAY_S: f64 = 1.2;
const STANDSTILL_M: f64 = 2.0;
const ACCELERATION_MPS2: f64 = 1.5;
const BRAKING_MPS2: f64 = 2.0;
const HARDEST_MPS2: f64 = 8.0;
const HALF_PATH_M: f64 = 1.8;

/// Acceleration (m/s^2) and turn rate (rad/s).
pub fn drive(ego: &EgoState, lidar: &Lidar) -> (f64, f64) {
    let wish = 1.0 - (ego.speed_mps / DESIRED_SPEED_MPS).powi(4);
    let need = match leader(ego, lidar) {
        Some((gap, closing)) => {
            let catching = ego.speed_mps * closing / (2.0 * (ACCELERATION_MPS2 * BRAKING_MPS2).sqrt());
            let wanted = STANDSTILL_M + (ego.speed_mps * HEADWAY_S + catching).max(0.0);
            (wanted / gap.max(0.1)).powi(2)
        }
        None => 0.0,
    };
    let acceleration = (ACCELERATION_MPS2 * (wish - need)).max(-HARDEST_MPS2).max(-10.0 * ego.speed_mps.max(0.0));

    let speed = ego.speed_mps.max(3.0);
    let sideways = -0.3 * ego.lane_offset_m - speed * ego.lane_heading_rad.sin();
    (acceleration, ego.speed_mps * ego.lane_curvature_per_m + sideways / speed)
}

/// Gap (m) to the nearest vehicle in the own path, and how fast it closes (m/s).
fn leader(ego: &EgoState, lidar: &Lidar) -> Option<(f64, f64)> {
    let beams = lidar.range_m.len();
    (0..beams)
        .filter(|&i| lidar.range_m[i] < lidar.limit_m)
        .map(|i| (2.0 * PI * i as f64 / beams as f64, lidar.range_m[i], lidar.range_rate_mps.get(i).copied().unwrap_or(0.0)))
        .filter(|(angle, range, _)| angle.cos() > 0.7 && (range * angle.sin()).abs() < HALF_PATH_M)
        .map(|(angle, range, rate)| (range * angle.cos() - 0.5 * ego.length_m, -rate * angle.cos()))
        .min_by(|a, b| a.0.total_cmp(&b.0))
}
