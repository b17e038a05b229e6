/** The texts of a share link's page, in the first of the browser's languages that it has. */

const WORDS = {
  en: {
    queued: "Queued", running: "Rendering", paused: "Paused", finished: "Finished", failed: "Failed", cancelled: "Cancelled",
    save: "Save PNG", none: "No picture yet.", lost: "No connection. Trying again …", frame: "Frame", until: "Link valid until",
    gone: "This link has expired or was withdrawn. Ask for a new one.", samples: "samples per pixel",
    notes: "Notes", add: "Add note", text: "New note", name: "Your name", saveNote: "Save note", cancel: "Cancel", pin: "Pin",
    whole: "Applies to the whole picture. Click or tap the picture to pin the note to a place.", pinned: "Pinned. Click or tap the picture to move the pin.",
    draft: "New note's pin: move it with the arrow keys", noNotes: "No notes yet.", guest: "guest", reply: "Reply", resolve: "Resolve",
    reopen: "Open again", resolved: "Resolved", by: "Resolved by {name}", approve: "Approve", change: "Ask for changes",
    approved: "Approved by {name}", "changes-requested": "Changes requested by {name}", place: "Note {n}: show its place", pinOf: "Note {n} by {name}: {text}",
    "note-author-missing": "Give your name.", "note-empty": "The note is empty.", "note-not-found": "This note was deleted.",
    "notes-too-fast": "Too many changes within a minute. Try again in {seconds} s.", "notes-too-many": "There are too many notes.",
    "share-link-without-notes": "This link only shows the picture.", failedToSave: "This was not saved. Try again.",
  },
  de: {
    queued: "Wartet", running: "Rendert", paused: "Angehalten", finished: "Fertig", failed: "Fehlgeschlagen", cancelled: "Abgebrochen",
    save: "PNG speichern", none: "Noch kein Bild.", lost: "Keine Verbindung. Neuer Versuch …", frame: "Frame", until: "Link gültig bis",
    gone: "Dieser Link ist abgelaufen oder wurde zurückgezogen. Bitten Sie um einen neuen.", samples: "Samples pro Pixel",
    notes: "Notizen", add: "Neue Notiz", text: "Neue Notiz", name: "Ihr Name", saveNote: "Notiz speichern", cancel: "Abbrechen", pin: "Anheften",
    whole: "Gilt dem ganzen Bild. Klicken oder tippen Sie darauf, um die Notiz an eine Stelle zu heften.", pinned: "Angeheftet. Klicken oder tippen Sie ins Bild, um die Markierung zu versetzen.",
    draft: "Markierung der neuen Notiz: mit den Pfeiltasten bewegen", noNotes: "Noch keine Notizen.", guest: "Gast", reply: "Antworten", resolve: "Erledigt",
    reopen: "Wieder öffnen", resolved: "Erledigt", by: "Erledigt von {name}", approve: "Freigeben", change: "Änderung erbitten",
    approved: "Freigegeben von {name}", "changes-requested": "Änderung erbeten von {name}", place: "Notiz {n}: Stelle zeigen", pinOf: "Notiz {n} von {name}: {text}",
    "note-author-missing": "Geben Sie Ihren Namen an.", "note-empty": "Die Notiz ist leer.", "note-not-found": "Diese Notiz wurde gelöscht.",
    "notes-too-fast": "Zu viele Änderungen in einer Minute. Versuchen Sie es in {seconds} s wieder.", "notes-too-many": "Es sind zu viele Notizen.",
    "share-link-without-notes": "Dieser Link zeigt nur das Bild.", failedToSave: "Das wurde nicht gespeichert. Versuchen Sie es noch einmal.",
  },
  zh: {
    queued: "排队中", running: "渲染中", paused: "已暂停", finished: "已完成", failed: "失败", cancelled: "已取消",
    save: "保存 PNG", none: "尚无图像。", lost: "连接中断,正在重试……", frame: "帧", until: "链接有效期至",
    gone: "此链接已过期或已被撤销。请索取新链接。", samples: "每像素采样数",
    notes: "备注", add: "添加备注", text: "新备注", name: "您的姓名", saveNote: "保存备注", cancel: "取消", pin: "钉住",
    whole: "针对整幅图像。点击图像可将备注钉在某处。", pinned: "已钉住。点击图像可移动图钉。",
    draft: "新备注的图钉：用方向键移动", noNotes: "尚无备注。", guest: "访客", reply: "回复", resolve: "解决",
    reopen: "重新打开", resolved: "已解决", by: "已由 {name} 解决", approve: "批准", change: "要求修改",
    approved: "已由 {name} 批准", "changes-requested": "{name} 要求修改", place: "备注 {n}：显示位置", pinOf: "备注 {n}（{name}）：{text}",
    "note-author-missing": "请填写您的姓名。", "note-empty": "备注为空。", "note-not-found": "此备注已被删除。",
    "notes-too-fast": "一分钟内的更改过多。请在 {seconds} 秒后重试。", "notes-too-many": "备注过多。",
    "share-link-without-notes": "此链接仅供查看图像。", failedToSave: "未保存。请重试。",
  },
};

export const language = navigator.languages.map((each) => each.slice(0, 2)).find((each) => each in WORDS) ?? "en";
export const words = WORDS[language];

/** Returns a text with values in place of `{name}`. @param {string} text @param {Record<string, unknown>} values */
export const filled = (text, values) => text.replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place));

/** Returns the time as a short date and time. @param {number} at unix seconds */
export const moment = (at) => new Date(at * 1000).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
