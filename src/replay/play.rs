//! Plays a recording in the live view, at its recorded pace or the one a client requests.

use anyhow::{Context, Result};
use sidehill_recording::live::{
    LiveView, PlaybackControl, PlaybackRequest, PlaybackState, PlaybackStatus,
};
use sidehill_recording::{MessageSink, Recording, Topic, scan};
use std::time::{Duration, Instant};

/// Longest pause between two messages; longer gaps in a recording are shortened to it.
const PAUSE_MAX_NS: u64 = 2_000_000_000;
/// Longest wait for a request before checking that a client is still connected.
const WAIT: Duration = Duration::from_millis(200);

/// Returns the first and the last time of a recording, ns.
///
/// # Errors
/// A file that can no longer be read.
pub(super) fn range_ns(recording: &Recording) -> Result<[u64; 2]> {
    let mut range = [u64::MAX, 0];
    visit(recording, &mut |_, time_ns, _| {
        range = [range[0].min(time_ns), range[1].max(time_ns)];
    })?;
    Ok(range)
}

/// Plays a recording to all clients. It ends with the recording or, once a client has paused, sought or changed the
/// speed, when no client is left.
///
/// # Errors
/// A file that can no longer be read.
pub(super) fn play(
    recording: &Recording,
    first_ns: u64,
    (live, control): (LiveView, &PlaybackControl),
) -> Result<()> {
    let mut player = Player {
        live,
        control,
        playing: true,
        speed: 1.0,
        first_ns,
        path: None,
        ground: None,
        time_ns: first_ns,
        from_ns: first_ns,
        due: Instant::now(),
        sought: false,
        controlled: false,
    };
    loop {
        player.begin();
        visit(recording, &mut |topic, time_ns, message| {
            player.message(topic, time_ns, message);
        })?;
        if !player.sought && !player.wait_at_end() {
            return Ok(());
        }
    }
}

fn visit(recording: &Recording, take: &mut dyn FnMut(Topic, u64, &[u8])) -> Result<()> {
    for file in &recording.files {
        scan(file, &mut |topic, time_ns, message| {
            take(topic, time_ns, message);
            Ok(())
        })
        .with_context(|| format!("{}: cannot be played", file.display()))?;
    }
    Ok(())
}

struct Player<'a> {
    live: LiveView,
    control: &'a PlaybackControl,
    playing: bool,
    speed: f32,
    /// First time of the recording, ns.
    first_ns: u64,
    /// The path before `from_ns` and the ground, without which there is little to see.
    path: Option<(u64, Vec<u8>)>,
    ground: Option<(u64, Vec<u8>)>,
    /// Newest time that was played, ns.
    time_ns: u64,
    /// Time from which on messages are played, ns.
    from_ns: u64,
    /// When the newest message was to be played.
    due: Instant,
    /// Whether playback continues elsewhere: the rest of this pass is skipped.
    sought: bool,
    /// Whether a client has made a request.
    controlled: bool,
}

impl Player<'_> {
    /// Begins a pass through the recording.
    fn begin(&mut self) {
        self.sought = false;
        (self.path, self.ground) = (None, None);
        self.time_ns = self.from_ns;
        self.due = Instant::now();
    }

    fn message(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        if self.sought {
            return;
        }
        if time_ns < self.from_ns {
            match topic {
                Topic::Path => self.path = Some((time_ns, message.to_vec())),
                Topic::Scene if self.ground.is_none() => {
                    self.ground = Some((time_ns, message.to_vec()));
                }
                _ => {}
            }
            return;
        }
        for (topic, held) in [
            (Topic::Scene, &mut self.ground),
            (Topic::Path, &mut self.path),
        ] {
            if let Some((time_ns, message)) = held.take() {
                self.live.put(topic, time_ns, &message);
            }
        }
        let pause_ns = time_ns.saturating_sub(self.time_ns).min(PAUSE_MAX_NS);
        self.due += Duration::from_nanos(pause_ns).div_f32(self.speed);
        loop {
            let left = self.due.saturating_duration_since(Instant::now());
            // No client is left that could resume.
            self.playing |= self.live.clients() == 0;
            let wait = if self.playing { left.min(WAIT) } else { WAIT };
            match self.control.next_request(wait) {
                Some(request) => self.obey(&request),
                None if self.playing && wait == left => break,
                None => {}
            }
            if self.sought {
                return;
            }
        }
        self.time_ns = self.time_ns.max(time_ns);
        self.live.put(topic, time_ns, message);
    }

    fn obey(&mut self, request: &PlaybackRequest) {
        self.controlled = true;
        self.playing = request.play;
        self.speed = request.speed;
        self.due = Instant::now();
        if let Some(seek_ns) = request.seek_ns {
            self.sought = true;
            self.from_ns = seek_ns;
            self.time_ns = seek_ns;
        }
        let status = if self.playing {
            PlaybackStatus::Playing
        } else {
            PlaybackStatus::Paused
        };
        self.tell(status, &request.id);
    }

    fn tell(&self, status: PlaybackStatus, id: &str) {
        self.live.tell(&PlaybackState {
            status,
            time_ns: self.time_ns,
            speed: self.speed,
            sought: self.sought,
            id: id.to_owned(),
        });
    }

    /// Announces the end, and returns whether a client continues: elsewhere, or from the start.
    fn wait_at_end(&mut self) -> bool {
        self.tell(PlaybackStatus::Ended, "");
        while self.controlled && self.live.clients() > 0 {
            let Some(request) = self.control.next_request(WAIT) else {
                continue;
            };
            let from_start = request.play.then_some(self.first_ns);
            self.obey(&PlaybackRequest {
                seek_ns: request.seek_ns.or(from_start),
                ..request
            });
            if self.sought {
                return true;
            }
        }
        false
    }
}
