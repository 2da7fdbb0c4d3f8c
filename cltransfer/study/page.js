"use strict";
(() => {
  const { study, questions, items } = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const shelf = `cltransfer-study-${study}`;
  const videos = [at("reference"), ...document.querySelectorAll(".pair video")];
  const sides = ["left", "right"];
  const total = items.length * questions.length;
  let state = restored() || { participant: "", answers: [] };
  let plan = [];
  let since = 0; // [ms] when the question appeared
  let shown = -1; // comparison whose videos are loaded
  let busy = false;
  const seen = new Set(); // videos of this comparison that have played to their end

  // Answers outlive a reload. A damaged or foreign record is not taken up.
  function restored() {
    try {
      const kept = JSON.parse(localStorage.getItem(shelf));
      if (!kept || !/^[\w-]{1,32}$/.test(kept.participant) || !Array.isArray(kept.answers) || kept.answers.length > total) return null;
      const asked = planned(kept.participant);
      return kept.answers.every((answer, i) => fits(answer, asked[Math.floor(i / questions.length)], questions[i % questions.length])) ? kept : null;
    } catch {
      return null;
    }
  }

  // Whether an answer is one to this comparison and question.
  function fits(answer, item, question) {
    const [left, right] = item.clips;
    const same = answer.item === item.name && answer.question === question.name && answer.left === left && answer.right === right;
    return same && item.clips.includes(answer.chosen) && /^[0-9]+[.][0-9]{2}$/.test(answer.seconds);
  }

  // Where the browser blocks storage the answers live in memory, and the page says so.
  function keep() {
    try {
      if (state.participant) localStorage.setItem(shelf, JSON.stringify(state));
      else localStorage.removeItem(shelf);
      at("unkept").hidden = true;
    } catch {
      at("unkept").hidden = false;
    }
  }

  // Random numbers in [0, 1) of a text: FNV-1a, then mulberry32.
  function randomOf(text) {
    let a = 2166136261;
    for (const c of text) a = Math.imul(a ^ c.codePointAt(0), 16777619);
    return () => {
      a = (a + 0x6d2b79f5) | 0;
      let t = Math.imul(a ^ (a >>> 15), 1 | a);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
  }

  function shuffled(list, random) {
    const found = [...list];
    for (let i = found.length - 1; i > 0; i--) {
      const j = Math.floor(random() * (i + 1));
      [found[i], found[j]] = [found[j], found[i]];
    }
    return found;
  }

  // Order and sides of one participant; each token of the sorted pair is on the left in half of the comparisons.
  function planned(participant) {
    const random = randomOf(`${study}/${participant}`);
    const offset = random() < 0.5 ? 0 : 1;
    const swaps = shuffled(items.map((_, i) => (i + offset) % 2 === 1), random);
    return shuffled(items.map((item, i) => ({ ...item, clips: swaps[i] ? [...item.clips].reverse() : item.clips })), random);
  }

  // Of the answers that there are: with another one it is not true any more.
  function tellSaved(text) {
    for (const place of ["saved", "partly"]) at(place).textContent = text;
  }

  function render() {
    const done = state.answers.length;
    tellSaved("");
    at("start").hidden = Boolean(state.participant);
    at("ask").hidden = !state.participant || done >= total;
    at("done").hidden = !state.participant || done < total;
    if (!at("start").hidden) return at("participant").focus();
    if (!plan.length) plan = planned(state.participant);
    if (done >= total) return finish();
    const comparison = Math.floor(done / questions.length);
    const question = done % questions.length;
    at("where").textContent = `Comparison ${comparison + 1} of ${items.length}`;
    at("who").textContent = state.participant;
    at("bar").style.width = `${(100 * done) / total}%`;
    at("count").textContent = `Question ${question + 1} of ${questions.length}`;
    at("text").textContent = questions[question].text;
    for (const name of ["back", "stop"]) at(name).disabled = done === 0;
    if (shown !== comparison) load(comparison);
    since = performance.now();
  }

  function load(comparison) {
    const item = plan[comparison];
    [item.reference, ...item.clips].forEach((token, i) => { videos[i].src = `videos/${token}.mp4`; });
    at("trouble").hidden = true;
    shown = comparison;
    seen.clear();
    unlock();
    replay();
  }

  // Who has not seen all three to the end has nothing to compare.
  function unlock() {
    const open = seen.size === videos.length;
    for (const side of sides) at(`choose-${side}`).disabled = !open;
    at("wait").hidden = open;
  }

  // All three start together, and start again together when the longest has ended.
  function replay() {
    for (const video of videos) {
      video.currentTime = 0;
      video.play().catch(() => {}); // a source that was replaced meanwhile; real faults raise "error"
    }
  }

  function choose(side) {
    if (at("ask").hidden || busy || seen.size < videos.length) return;
    const done = state.answers.length;
    const item = plan[Math.floor(done / questions.length)];
    const [left, right] = item.clips;
    const seconds = ((performance.now() - since) / 1000).toFixed(2);
    state.answers.push({ item: item.name, question: questions[done % questions.length].name, left, right, chosen: item.clips[side], seconds });
    keep();
    busy = true;
    at(sides[side]).classList.add("chosen");
    setTimeout(() => {
      at(sides[side]).classList.remove("chosen");
      busy = false;
      render();
    }, 260);
  }

  function takeBack() {
    if (!state.participant || !state.answers.length || busy) return;
    state.answers.pop();
    keep();
    render();
  }

  function rest() {
    videos.forEach((video) => video.pause());
    shown = -1;
  }

  function finish() {
    rest();
    at("summary").textContent = `All ${total} questions are answered (${state.participant}).`;
    at("download").focus();
  }

  function download() {
    const header = ["study", "participant", "item", "question", "left", "right", "chosen", "seconds"];
    const rows = state.answers.map((a) => [study, state.participant, a.item, a.question, a.left, a.right, a.chosen, a.seconds]);
    const text = [header, ...rows].map((row) => row.join(",")).join("\n") + "\n";
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    link.download = `answers-${study}-${state.participant}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    tellSaved(`Saved as ${link.download}, where your browser keeps downloads.`);
  }

  function another() {
    if (state.answers.length && !at("saved").textContent && !confirm("The answers were not downloaded. Throw them away?")) return;
    state = { participant: "", answers: [] };
    keep();
    at("participant").value = "";
    plan = [];
    rest();
    render();
  }

  at("join").addEventListener("submit", (event) => {
    event.preventDefault();
    state = { participant: at("participant").value.trim(), answers: [] };
    plan = [];
    keep();
    render();
  });
  at("choose-left").addEventListener("click", () => choose(0));
  at("choose-right").addEventListener("click", () => choose(1));
  at("back").addEventListener("click", takeBack);
  at("undo").addEventListener("click", takeBack);
  at("again").addEventListener("click", replay);
  at("ask").addEventListener("click", (event) => { // by mouse: what the space bar does is play, not press it again
    if (event.detail) event.target.closest("button")?.blur();
  });
  for (const name of ["download", "stop"]) at(name).addEventListener("click", download);
  for (const name of ["next", "another"]) at(name).addEventListener("click", another);
  for (const video of videos) {
    video.addEventListener("ended", () => {
      seen.add(video);
      unlock();
      if (videos.every((v) => v.ended || v.error)) setTimeout(replay, 500);
    });
    video.addEventListener("error", () => { at("trouble").hidden = false; });
  }
  document.addEventListener("keydown", (event) => {
    if (at("ask").hidden || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && event.target.closest("button, a, input")) return; // presses it
    const act = { ArrowLeft: () => choose(0), ArrowRight: () => choose(1), Backspace: takeBack, " ": replay }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  render();
})();
