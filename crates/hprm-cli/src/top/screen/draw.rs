//! One picture of the screen.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table, TableState, Wrap};

use crate::top::federation::Federation;
use crate::top::rates::flows;
use crate::top::text::{TITLES, connection, notes, row, title, why};
use crate::top::why::{Kind, Part};

/// How many columns of characters are between two of the table.
const GAP: u16 = 2;

/// What is shown.
pub(super) struct View {
    before: Option<Federation>,
    now: Federation,
    chosen: TableState,
    pub(super) is_paused: bool,
    pub(super) has_ended: bool,
}

impl View {
    pub(super) fn new(now: Federation, chosen: Option<usize>) -> Self {
        let chosen = TableState::default().with_selected(Some(chosen.unwrap_or(0)));
        Self { before: None, now, chosen, is_paused: false, has_ended: false }
    }

    /// The federation is like that now.
    pub(super) fn update(&mut self, now: Federation) {
        self.before = Some(std::mem::replace(&mut self.now, now));
    }

    /// Chooses another federate, so many rows below.
    pub(super) fn step(&mut self, by: i64) {
        let last =
            i64::try_from(self.now.members.len()).unwrap_or(i64::MAX).saturating_sub(1).max(0);
        let at = i64::try_from(self.chosen()).unwrap_or(0).saturating_add(by).clamp(0, last);
        self.chosen.select(usize::try_from(at).ok());
    }

    fn chosen(&self) -> usize {
        self.chosen.selected().unwrap_or(0).min(self.now.members.len().saturating_sub(1))
    }
}

/// Draws everything, as far as there is room for it.
pub(super) fn draw(frame: &mut Frame<'_>, view: &mut View) {
    let rows = u16::try_from(view.now.members.len()).unwrap_or(u16::MAX);
    let half = frame.area().height / 2;
    let table = rows.saturating_add(1).min(half.max(2));
    let [top, middle, bottom, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(table),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    frame.render_widget(Line::from(title(&view.now)).style(Modifier::BOLD), top);
    federates(frame, view, middle);
    details(frame, view, bottom);
    let end = if view.has_ended { "the federation has ended  " } else { "" };
    let pause = if view.is_paused { "paused  " } else { "" };
    let help = format!("{end}{pause}arrows: choose a federate   p: pause   q: end");
    frame.render_widget(Line::from(help).style(Modifier::DIM), keys);
}

fn federates(frame: &mut Frame<'_>, view: &mut View, area: Rect) {
    let numbers = 0..view.now.members.len();
    let cells: Vec<_> = numbers.map(|it| row(view.before.as_ref(), &view.now, it)).collect();
    let width = |column: usize| {
        let widths = cells.iter().map(|cells| cells[column].chars().count());
        let widest = widths.chain([TITLES[column].len()]).max().unwrap_or(0);
        u16::try_from(widest).unwrap_or(u16::MAX)
    };
    // Where there is no room for all columns, the last ones are left out.
    let mut left = area.width;
    let widths = (0..TITLES.len()).map(width).map_while(|width| {
        let shown = (left >= width).then_some(Constraint::Length(width));
        left = left.saturating_sub(width.saturating_add(GAP));
        shown
    });
    let widths: Vec<_> = widths.collect();
    let columns = widths.len();
    let rows = cells.iter().enumerate().map(|(number, cells)| {
        let kind = view.now.doing(Part::Federate(number)).kind;
        let cells = cells.iter().take(columns).enumerate().map(|(column, text)| {
            let style = if column == 2 { style(kind) } else { Style::default() };
            Cell::from(Span::styled(text.clone(), style))
        });
        Row::new(cells)
    });
    let table = Table::new(rows, widths)
        .header(Row::new(TITLES.into_iter().take(columns)).style(Modifier::UNDERLINED))
        .row_highlight_style(Modifier::REVERSED)
        .column_spacing(GAP);
    // A screen that was lower before showed later rows; where there is room again, none is above the first.
    let shown = usize::from(area.height.saturating_sub(1));
    let most = view.now.members.len().saturating_sub(shown);
    *view.chosen.offset_mut() = view.chosen.offset().min(most);
    frame.render_stateful_widget(table, area, &mut view.chosen);
}

/// What there is to say of the chosen federate.
fn details(frame: &mut Frame<'_>, view: &View, area: Rect) {
    let Some(member) = view.now.members.get(view.chosen()) else { return };
    let mut lines: Vec<_> =
        why(&view.now, Some(view.chosen())).into_iter().map(Line::from).collect();
    lines.extend(notes(&view.now, member).map(Line::from));
    let flows = flows(view.before.as_ref(), &view.now);
    let own = flows.iter().filter(|flow| flow.from == member.name || flow.to == member.name);
    let mut own = own.peekable();
    if own.peek().is_some() {
        lines.push(Line::default());
    }
    for flow in own {
        let [name, messages, rate, bytes, byte_rate, last] =
            <[String; 6]>::try_from(connection(flow)).unwrap_or_default();
        lines.push(Line::from(format!(
            "{name}   {messages} messages, {rate}/s   {bytes}, {byte_rate}/s   last tag {last}"
        )));
    }
    let block = Block::new().borders(Borders::TOP).title(format!(" {} ", member.name));
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: false }).block(block), area);
}

fn style(kind: Kind) -> Style {
    match kind {
        Kind::Reacts | Kind::Stopped | Kind::Absent => Style::new().fg(Color::Red),
        Kind::Waits | Kind::Starts => Style::new().fg(Color::Yellow),
        Kind::Runs | Kind::Idle => Style::new().fg(Color::Green),
        Kind::Unseen | Kind::Ended => Style::new().add_modifier(Modifier::DIM),
    }
}
