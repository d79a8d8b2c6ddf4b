//! The screen of `hprm top`: reads the boards from time to time, draws, and obeys keys.
//!
//! What is drawn is in `screen/draw.rs`; this owns the terminal, and gives it back however it ends.

mod draw;

use std::io;
use std::mem::ManuallyDrop;
use std::thread;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

use self::draw::{View, draw};
use super::collect::Boards;
use crate::message::Error;

/// Shows a federation until a key or a signal ends it.
///
/// # Errors
///
/// If the terminal cannot be used.
pub(super) fn screen(boards: Boards, only: Option<usize>, interval: Duration) -> Result<(), Error> {
    let failed = |error: io::Error| Error::new(format!("cannot use the terminal: {error}"));
    // Restores the terminal before the message of a panic, too.
    let terminal = ratatui::try_init().map_err(failed)?;
    // Its end would print an error if the terminal is gone, and where there is no terminal to print it on, panic.
    let mut terminal = ManuallyDrop::new(terminal);
    let shown = end_on_signals().and_then(|()| show(&mut terminal, boards, only, interval));
    let cursor = terminal.show_cursor();
    let restored = ratatui::try_restore();
    shown.and(cursor).and(restored).map_err(failed)
}

/// Has a signal restore the terminal and end the process. In a thread of its own, because the wait for keys does not
/// return once the terminal is gone.
fn end_on_signals() -> io::Result<()> {
    let mut signals = Signals::new([SIGHUP, SIGINT, SIGTERM])?;
    let end = move || {
        if let Some(signal) = signals.forever().next() {
            // The signal ends the process, so no error can be reported; the terminal may be gone, too.
            let _ = ratatui::try_restore();
            let _ = emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(end).map(drop)
}

fn show(
    terminal: &mut DefaultTerminal,
    mut boards: Boards,
    only: Option<usize>,
    interval: Duration,
) -> io::Result<()> {
    let mut view = View::new(boards.read(), only);
    let mut next = Instant::now() + interval.min(Duration::from_millis(300));
    loop {
        terminal.draw(|frame| draw(frame, &mut view))?;
        let left = next.saturating_duration_since(Instant::now());
        if event::poll(left)?
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
