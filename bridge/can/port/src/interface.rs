use socketcan::CanInterface;

/// Returns the bit rate of an interface, bit/s; none where it has none, as a virtual one.
pub fn bit_rate(interface: &str) -> Option<u32> {
    let details = CanInterface::open(interface).ok()?;
    details.bit_rate().ok().flatten().filter(|rate| *rate > 0)
}

/// Returns how many frames the interface has received and lost since it was made; none where there is no such interface.
pub fn lost_frames(interface: &str) -> Option<u64> {
    let counter = |name: &str| {
        let file = format!("/sys/class/net/{interface}/statistics/{name}");
        let text = std::fs::read_to_string(file).ok()?;
        text.trim().parse::<u64>().ok()
    };
    Some(counter("rx_dropped")? + counter("rx_over_errors")? + counter("rx_fifo_errors")?)
}
