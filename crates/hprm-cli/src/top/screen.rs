//! The screen of `hprm top`: reads the boards from time to time, draws, and obeys keys.
//!
//! What is drawn is in `screen/draw.rs`; this owns the terminal, and gives it back however it ends.

mod draw;

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use self::draw::{View, draw};
use super::collect::Boards;
use crate::message::Error;

/// The longest time until a signal is obeyed.
const LOOK: Duration = Duration::from_millis(100);

/// Shows a federation until a key or a signal ends it, or the federation has ended.
///
/// # Errors
///
/// If the terminal cannot be used.
pub(super) fn screen(boards: Boards, only: Option<usize>, interval: Duration) -> Result<(), Error> {
    let failed = |error: io::Error| Error::new(format!("cannot use the terminal: {error}"));
    let asked = Arc::new(AtomicBool::new(false));
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&asked)).map_err(failed)?;
    }
    // Restores the terminal before the message of a panic, too.
    let mut terminal = ratatui::try_init().map_err(failed)?;
    let shown = show(&mut terminal, boards, only, (interval, &asked));
    let restored = ratatui::try_restore();
    shown.and(restored).map_err(failed)
}

fn show(
    terminal: &mut DefaultTerminal,
    mut boards: Boards,
    only: Option<usize>,
    (interval, asked): (Duration, &AtomicBool),
) -> io::Result<()> {
    let mut view = View::new(boards.read(), only);
    let mut next = Instant::now() + interval.min(Duration::from_millis(300));
    while !asked.load(Ordering::Relaxed) {
        terminal.draw(|frame| draw(frame, &mut view))?;
        let left = next.saturating_duration_since(Instant::now());
        if event::poll(left.min(LOOK))?
            && let Event::Key(key) = event::read()?
            && !obey(key, &mut view)
        {
            return Ok(());
        }
        if Instant::now() < next {
            continue;
        }
        next = Instant::now() + interval;
        if view.is_paused {
            continue;
        }
        match boards.again() {
            Some(found) => {
                boards = found;
                view.update(boards.read());
            }
            None => view.has_ended = true,
        }
    }
    Ok(())
}

/// Does what a key asks for. Returns whether to go on.
fn obey(key: KeyEvent, view: &mut View) -> bool {
    if key.kind == KeyEventKind::Release {
        return true;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('c') if control => return false,
        KeyCode::Char('q') | KeyCode::Esc => return false,
        KeyCode::Char('p') | KeyCode::Char(' ') => view.is_paused = !view.is_paused,
        KeyCode::Up | KeyCode::Char('k') => view.step(-1),
        KeyCode::Down | KeyCode::Char('j') => view.step(1),
        KeyCode::PageUp => view.step(-10),
        KeyCode::PageDown => view.step(10),
        KeyCode::Home | KeyCode::Char('g') => view.step(i64::MIN),
        KeyCode::End | KeyCode::Char('G') => view.step(i64::MAX),
        _ => {}
    }
    true
}
