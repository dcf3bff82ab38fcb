// made by `make page` of page/src efbf3fc20cde66af
"use strict";(()=>{var distance=(one,two)=>Math.hypot(two[0]-one[0],two[1]-one[1]),middle=(one,two)=>[(one[0]+two[0])/2,(one[1]+two[1])/2],rounded=([x,y])=>[Math.round(x*1e3)/1e3,
Math.round(y*1e3)/1e3],edgesOf=ring=>ring.map((place2,number)=>[place2,ring[(number+1)%ring.length]]);function nearestOnEdge([x,y],[[ax,ay],[bx,by]]){let[dx,dy]=[
bx-ax,by-ay],share=Math.max(0,Math.min(1,((x-ax)*dx+(y-ay)*dy)/(dx*dx+dy*dy||1)));return[ax+share*dx,ay+share*dy]}function contains([x,y],ring){let inside=!1;for(let[[ax,ay],[bx,by]]of edgesOf(ring))ay>y!=by>y&&x<ax+(y-ay)/(by-ay)*(bx-ax)&&(inside=!inside);return inside}function axisOf(ring){
let[one,two]=edgesOf(ring).reduce((best,edge)=>distance(edge[0],edge[1])>distance(best[0],best[1])?edge:best),length=distance(one,two)||1;return[(two[0]-one[0])/
length,(two[1]-one[1])/length]}function snap(place2,{corners=[],edges=[],points=[],from,axis=[1,0]},reach){let nearest=places=>{let best=null,least=reach;for(let one of places)
distance(one,place2)<least&&([best,least]=[one,distance(one,place2)]);return best},corner=nearest(corners);if(corner)return{place:corner,kind:"corner"};let edge=edges.
reduce((best,one)=>{let away=distance(nearestOnEdge(place2,one),place2);return away<reach&&(!best||away<distance(nearestOnEdge(place2,best),place2))?one:best},null),
line=from?frameLine(place2,from,axis,reach):null;if(edge&&line){let met=crossing(from||place2,line.way,edge);if(met&&distance(met,place2)<2*reach)return{place:met,
kind:"edge and frame"}}if(edge)return{place:nearestOnEdge(place2,edge),kind:"edge"};if(line)return{place:line.place,kind:"frame"};let point=nearest(points);return point?
{place:point,kind:"point"}:{place:place2,kind:""}}function frameLine([x,y],[fx,fy],[ux,uy],reach){let along=(x-fx)*ux+(y-fy)*uy,across=(y-fy)*ux-(x-fx)*uy;return Math.
min(Math.abs(along),Math.abs(across))>reach?null:Math.abs(across)<=Math.abs(along)?{place:[fx+along*ux,fy+along*uy],way:[ux,uy]}:{place:[fx-across*uy,fy+across*
ux],way:[-uy,ux]}}function meeting([fx,fy],[ux,uy],[[ax,ay],[bx,by]]){let[dx,dy]=[bx-ax,by-ay],size=ux*dy-uy*dx;if(Math.abs(size)<.001*Math.hypot(ux,uy)*Math.hypot(
dx,dy))return null;let share=((ax-fx)*uy-(ay-fy)*ux)/size,place2=[ax+share*dx,ay+share*dy];return{place:place2,share,ahead:((place2[0]-fx)*ux+(place2[1]-fy)*uy)/
(ux*ux+uy*uy)}}function crossing(from,way,edge){let met=meeting(from,way,edge);return!met||met.share<-1e-9||met.share>1+1e-9?null:met.place}function carriedOn(ring,number,overEnd,others,reach=25){
let count=ring.length,at=place2=>ring[(number+place2)%count];if(!overEnd)return carriedOn([...ring].reverse(),(2*count-2-number)%count,!0,others,reach)?.reverse()??
null;let[start2,end]=[at(0),at(1)],length=distance(start2,end)||1,way=[(end[0]-start2[0])/length,(end[1]-start2[1])/length],best=null,least=reach;for(let later=2;later<
count-1;later++){let met=meeting(end,way,[at(later),at(later+1)]);if(!(!met||met.ahead<.001||met.ahead>least||met.share>1+1e-9)){[best,least]=[[start2,rounded(met.
place),...Array.from({length:count-later-1},(_,place2)=>at(later+1+place2))],met.ahead];break}}for(let edge of others){let met=meeting(end,way,edge);if(!met||met.
ahead<.05||met.ahead>least||met.share<-1e-9||met.share>1+1e-9)continue;let moved=new Map(edgeMoved(ring,(number+1)%count,met.place));[best,least]=[ring.map(corner=>moved.
get(corner)??corner),met.ahead]}return best}function ridgesOf(edges,rings){let outline=rings.flatMap(edgesOf),found=new Map;for(let[one,two]of edges){let ends=[
[one[0],one[1]],[two[0],two[1]]].map(place2=>rounded(place2)),length=distance(ends[0],ends[1]),between=middle(ends[0],ends[1]);length<.5||Math.abs(one[2]-two[2])>
.1*length||outline.some(edge=>distance(nearestOnEdge(between,edge),between)<.1)||found.set(ends.map(String).sort().join(),ends)}return[...found.values()]}function movedAside([
one,two],to){let moved=rectangle(one,two,to);return[rounded(moved[3]),rounded(moved[2])]}function rectangle(one,two,three){let length=distance(one,two)||1,normal=[
-(two[1]-one[1])/length,(two[0]-one[0])/length],deep=(three[0]-one[0])*normal[0]+(three[1]-one[1])*normal[1],moved=place2=>[place2[0]+deep*normal[0],place2[1]+deep*
normal[1]];return[one,two,moved(two),moved(one)]}function closingCorner(places){if(places.length<3)return null;let[one]=places,last=places[places.length-1],[ux,
uy]=axisOf(places.slice(0,2)),away=[last[0]-one[0],last[1]-one[1]],along=away[0]*ux+away[1]*uy,across=away[1]*ux-away[0]*uy;if(Math.abs(along)<1e-6||Math.abs(across)<
1e-6)return null;let before=places[places.length-2];return Math.abs((last[0]-before[0])*ux+(last[1]-before[1])*uy)>Math.abs((last[1]-before[1])*ux-(last[0]-before[0])*
uy)?[last[0]+across*uy,last[1]-across*ux]:[last[0]-along*ux,last[1]-along*uy]}function divided(ring,one,two){let way=[two[0]-one[0],two[1]-one[1]],side=([x,y])=>way[0]*
(y-one[1])-way[1]*(x-one[0]),parts=[[],[]],changes=0;for(let[a,b]of edgesOf(ring)){let here=side(a)>=0?0:1,there=side(b)>=0?0:1;if(parts[here].push(a),here===there)
continue;changes++;let share=side(a)/(side(a)-side(b)),met=[a[0]+share*(b[0]-a[0]),a[1]+share*(b[1]-a[1])];parts[0].push(met),parts[1].push(met)}return changes===
2?parts:null}function edgeMoved(ring,number,to){let one=ring[number],two=ring[(number+1)%ring.length],length=distance(one,two)||1,normal=[-(two[1]-one[1])/length,
(two[0]-one[0])/length],deep=(to[0]-one[0])*normal[0]+(to[1]-one[1])*normal[1],before=ring[(number+ring.length-1)%ring.length],after=ring[(number+2)%ring.length],
shift=(corner,beside)=>{let[wx,wy]=[beside[0]-corner[0],beside[1]-corner[1]],rise=wx*normal[0]+wy*normal[1],steep=Math.abs(rise)>.3*Math.hypot(wx,wy),step=steep?
[wx*deep/rise,wy*deep/rise]:[normal[0]*deep,normal[1]*deep];return rounded([corner[0]+step[0],corner[1]+step[1]])};return[[one,shift(one,before)],[two,shift(two,
after)]]}var Draft=class{constructor(){this.places=[],this.undone=[]}add(place2){this.places.push(rounded(place2)),this.undone=[]}undo(){let last=this.places.pop();
return last&&this.undone.push(last),!!last}redo(){let last=this.undone.pop();return last&&this.places.push(last),!!last}};var REACH=10,KEY_STEP=.1,HINTS={corners:"Drag a corner or an edge; a click on an edge adds a corner. Keys: , . choose a corner, arrows move it (shift: 1 m), Ent\
er sets it, Insert adds one, Backspace deletes it.",rectangle:"Three clicks: two ends of a wall, and the opposite side. Keys: arrows move the cross, Enter sets \
a place.",polygon:"A click a corner, right angles to the first wall; Enter on the last place or a click on the first corner closes it.",split:"Two clicks: a lin\
e across the building.",join:"Click on the building that is one with this.",carry:"Click on an edge near the end over which it is carried on, to what its line m\
eets next.",ridge:"Drag a ridge. Keys: , . choose one, arrows move it (shift: 1 m), Page Up and Down raise it, Enter sets it.",unite:"Two clicks: the faces that\
 are one.",dormer:"Three clicks: two ends of a side of the face, and the opposite side."},HOLDING=["corners","ridge"],FREE=["join","carry","unite"],ALONE=["rect\
angle","polygon"],Tools=class{constructor(view2,plans2,act2,say2){Object.assign(this,{view:view2,plans:plans2,act:act2,say:say2}),this.view=view2,this.plans=plans2,
this.act=act2,this.say=say2,this.name="",this.draft=new Draft,this.held=null,this.ridges=[],this.cursor=null,this.corner=-1,this.kind="",this.free=!1,this.marks=
[],view2.draw=()=>this.draw(),this.listen()}get id(){return this.view.chosen}get ring(){return this.plans[this.id]?.[0]||[]}get height(){return this.view.height(
this.id)}use(name){let{view:view2}=this;this.name=name===this.name?"":name,this.name&&!ALONE.includes(this.name)&&!this.ring.length&&(this.name="",this.say("cho\
ose a building first")),this.draft=new Draft,Object.assign(this,{held:null,cursor:null,corner:-1,ridges:this.name==="ridge"?ridgesOf(view2.edges(this.id),this.plans[this.
id]):[]}),this.name&&(view2.above(),this.say(HINTS[this.name])),view2.canvas.style.cursor=this.name?"crosshair":"";for(let button of document.querySelectorAll("\
[data-tool]"))button.setAttribute("aria-pressed",String(button.dataset.tool===this.name));this.draw()}joined(place2,from){if(this.kind="",this.free)return rounded(
place2);let reach=REACH*this.view.step,near=Object.entries(this.plans).filter(([id])=>id!==this.id||!this.held).flatMap(([,rings])=>rings).filter(ring=>ring.some(
corner=>distance(corner,place2)<60)),targets={corners:near.flat(),edges:near.flatMap(edgesOf),points:this.view.points(place2,reach),from,axis:this.ring.length?axisOf(
this.ring):this.draft.places.length>1?axisOf(this.draft.places.slice(0,2)):void 0},found=snap(place2,targets,reach);return this.kind=found.kind,rounded(found.place)}listen(){
let{view:view2}=this,stage=view2.canvas.parentElement,stop=event=>{event.stopPropagation(),event.preventDefault()},moved=0;stage.addEventListener("pointerdown",
event=>{if(!this.name||event.button||event.shiftKey||event.target!==view2.canvas)return;let place2=view2.under(event,this.height);place2&&(moved=0,!(HOLDING.includes(
this.name)&&!this.grip(place2))&&(view2.canvas.focus({preventScroll:!0}),view2.canvas.setPointerCapture(event.pointerId),stop(event)))},!0),stage.addEventListener(
"pointermove",event=>{if(!this.name)return;let place2=view2.under(event,this.height);place2&&(this.free=event.altKey,this.held?(moved+=Math.hypot(event.movementX,
event.movementY),this.drag(place2),stop(event)):HOLDING.includes(this.name)||(this.cursor=this.taken(place2),this.draw()))},!0),stage.addEventListener("pointeru\
p",event=>{if(!this.name||event.button||event.target!==view2.canvas)return;let place2=view2.under(event,this.height);place2&&(this.held?(stop(event),this.drop(place2,
moved)):HOLDING.includes(this.name)||(stop(event),this.take(this.taken(place2))))},!0)}taken(place2){return FREE.includes(this.name)?place2:this.joined(place2,this.
draft.places.at(-1))}grip(place2){let{ring}=this,reach=REACH*this.view.step;if(this.name==="ridge")return this.corner=this.ridges.findIndex(edge=>distance(nearestOnEdge(
place2,edge),place2)<reach),this.corner>=0&&(this.held={moves:[],number:this.corner,edge:!0,to:place2,rise:0}),this.corner>=0;let corner=ring.findIndex(one=>distance(
one,place2)<reach),number=corner>=0?corner:edgesOf(ring).findIndex(edge=>distance(nearestOnEdge(place2,edge),place2)<reach);return number<0?!1:(this.held={moves:[],
number,edge:corner<0},this.corner=corner,!0)}drag(place2){let{held,ring}=this;if(!held)return;if(held.to)return held.to=this.joined(place2,void 0),this.draw();let before=ring[(held.
number+ring.length-1)%ring.length],to=this.joined(place2,held.edge?void 0:before);held.moves=held.edge?edgeMoved(ring,held.number,to):[[ring[held.number],to]],this.
draw()}drop(place2,moved){let{held,ring}=this;if(this.held=null,held?.to)return moved>4?this.moveRidge(held):this.draw();if(held&&moved>4&&held.moves.length)return this.
act({do:"move",id:this.id,moves:held.moves});if(held?.edge)return this.insert(held.number,rounded(nearestOnEdge(place2,edgesOf(ring)[held.number])));this.draw()}moveRidge({
number,to,rise}){return this.end({do:"ridge",id:this.id,line:this.ridges[number],to,rise:rise??0})}carried(place2){let{ring,id}=this,away=edgesOf(ring).map(edge=>distance(
nearestOnEdge(place2,edge),place2)),number=away.indexOf(Math.min(...away));if(!(away[number]<2*REACH*this.view.step))return null;let[one,two]=edgesOf(ring)[number],
others=Object.entries(this.plans).filter(([other])=>other!==id).flatMap(([,rings])=>rings.flatMap(edgesOf)).filter(edge=>distance(edge[0],place2)<100);return carriedOn(
ring,number,distance(place2,two)<distance(place2,one),others)}insert(number,place2){return this.corner=number+1,this.act({do:"outline",id:this.id,plan:[...this.
ring.slice(0,number+1),place2,...this.ring.slice(number+1)]})}take(place2){let{draft,name,id}=this;if(name==="join"){let other=Object.keys(this.plans).find(one=>one!==
id&&contains(place2,this.plans[one][0]));return other?this.end({do:"join",ids:[id,other]}):this.say("no other building is there")}if(name==="carry"){let plan=this.
carried(place2);return plan?this.end({do:"outline",id,plan}):this.say("the line of the edge meets nothing there")}if(name==="polygon"&&draft.places.length>2&&distance(
place2,draft.places[0])<REACH*this.view.step)return this.close();if(draft.add(place2),name==="unite"&&draft.places.length===2)return this.end({do:"unite",id,at:draft.
places});if((name==="rectangle"||name==="dormer")&&draft.places.length===3){let plan=rectangle(draft.places[0],draft.places[1],draft.places[2]).map(rounded);return this.
end(name==="dormer"?{do:"face",id,plan}:{do:"draw",plan})}if(name==="split"&&draft.places.length===2)return this.end({do:"split",id,line:draft.places});this.draw()}close(){
let{places}=this.draft,last=closingCorner(places);return places.length<3?this.say("a polygon has three corners at least"):this.end({do:"draw",plan:last?[...places,
rounded(last)]:places})}end(action){return this.use(""),this.act(action)}key(event){let arrow={ArrowLeft:[-1,0],ArrowRight:[1,0],ArrowUp:[0,1],ArrowDown:[0,-1]}[event.
key],{ring,draft,view:view2}=this;if(!this.name)return!1;let far=event.shiftKey?10*KEY_STEP:KEY_STEP;if(event.key==="Escape")this.use("");else if(event.ctrlKey||
event.metaKey){if(!draft.places.length&&!draft.undone.length||(event.key==="z"?!draft.undo():!(event.key==="y"&&draft.redo())))return!1}else if(HOLDING.includes(
this.name)&&(event.key==="."||event.key===",")){let[count,word]=this.name==="ridge"?[this.ridges.length,"ridge"]:[ring.length,"corner"];this.held=null,this.corner=
count?(this.corner+(event.key==="."?1:this.corner<0?0:-1)+count)%count:-1,this.say(count?`${word} ${this.corner+1} of ${count}`:`there is no ${word}`)}else if(this.
name==="ridge"&&this.corner>=0){let line=this.ridges[this.corner],held=this.held??{moves:[],number:this.corner,edge:!0,to:middle(line[0],line[1]),rise:0},[x,y]=held.
to??[0,0],up={PageUp:1,PageDown:-1}[event.key];if(event.key==="Enter"&&this.held)this.moveRidge(held);else if(arrow)this.held={...held,to:[x+far*arrow[0],y+far*
arrow[1]]};else if(up)this.held={...held,rise:(held.rise??0)+far*up};else return!1;this.held&&this.say(`ridge ${this.held.rise?.toFixed(1)} m higher`)}else if(this.
name==="corners"&&this.corner>=0){let at=ring[this.corner],next2=ring[(this.corner+1)%ring.length];if(arrow){let from=this.held?this.held.moves[0][1]:at;this.held=
{moves:[[at,rounded([from[0]+far*arrow[0],from[1]+far*arrow[1]])]],number:this.corner,edge:!1}}else if(event.key==="Enter"&&this.held){let{moves}=this.held;this.
held=null,this.act({do:"move",id:this.id,moves})}else if(event.key==="Insert")this.insert(this.corner,rounded(middle(at,next2)));else if(event.key==="Backspace")
this.act({do:"outline",id:this.id,plan:ring.filter((_,number)=>number!==this.corner)});else return!1}else if(arrow){let[x,y]=this.cursor||draft.places.at(-1)||view2.
viewer.camera.target.slice(0,2);this.cursor=rounded([x+far*arrow[0],y+far*arrow[1]])}else if(event.key==="Enter"&&this.cursor){let last=draft.places.at(-1);this.
name==="polygon"&&last&&distance(last,this.cursor)<.05?this.close():this.take(this.cursor)}else return!1;return this.draw(),!0}draw(){let{view:view2,ring,name,draft,
held,cursor}=this,z=this.height,shapes=this.marks.map(line=>({line,z,kind:"mark"})),moved=ring.map(corner=>held?.moves.find(([from])=>from===corner)?.[1]||corner);
this.ridges.forEach((line,number)=>shapes.push({line:held?.to&&held.number===number?movedAside(line,held.to):line,z,kind:number===this.corner?"ridge held":"ridg\
e",data:{ridge:number}})),name&&ring.length&&this.id&&shapes.push({line:moved,closed:!0,z,kind:"plan"}),name==="corners"&&moved.forEach((at,number)=>shapes.push(
{at,z,kind:number===this.corner?"corner held":"corner",data:{corner:number}}));let places=cursor?[...draft.places,cursor]:draft.places,carried=name==="carry"&&cursor?
this.carried(cursor):null;if(carried&&shapes.push({line:carried,closed:!0,z,kind:"draft"}),(name==="rectangle"||name==="dormer")&&places.length===3)shapes.push(
{line:rectangle(places[0],places[1],places[2]),closed:!0,z,kind:"draft"});else if(name==="split"&&places.length===2&&divided(ring,places[0],places[1]))for(let line of divided(
ring,places[0],places[1])||[])shapes.push({line,closed:!0,z,kind:"draft"});else places.length>1&&shapes.push({line:places,z,kind:"draft"});draft.places.forEach(
at=>shapes.push({at,z,kind:"corner"})),cursor&&shapes.push({at:cursor,z,kind:"cursor"}),(cursor||held)&&this.kind&&shapes.push({at:cursor||held?.to||held?.moves[0]?.[1],
z,kind:"joined",text:this.kind}),view2.show(shapes.filter(shape=>shape.line||shape.at))}};var SVG="http://www.w3.org/2000/svg",byId=name=>document.getElementById(name),viewOf=()=>new Promise(done=>{let{window}=globalThis;(window.eavesExtensions??=[]).
push(tools2=>done(new View(tools2)))}),View=class{constructor(page){this.page=page,this.viewer=page.viewer,this.canvas=byId("scene"),this.sheet=document.createElementNS(
SVG,"svg"),this.sheet.id="table-sheet",this.canvas.after(this.sheet),this.draw=()=>{};let last="",watch=()=>{let{canvas,viewer:{camera}}=this,now=[camera.azimuth,
camera.elevation,camera.distance,camera.flat,...camera.target,canvas.clientWidth,canvas.clientHeight].join();now!==last&&this.draw(),last=now,requestAnimationFrame(
watch)};watch()}get chosen(){return this.page.rows[this.page.chosen]?.id??""}number(id){return this.page.rows.findIndex(row=>row.id===id)}row(id){return this.page.
rows[this.number(id)]}choose(id){this.page.choose(this.number(id))}above(){(!this.viewer.camera.flat||this.viewer.camera.elevation<1.5)&&this.viewer.view("above"),
this.viewer.ask()}height(id){let row=this.row(id),spot=this.viewer.spots[this.number(id)];return Number.isFinite(row?.h_eaves)?row.h_eaves-this.viewer.scene.points.
base:spot&&Number.isFinite(spot.high[2])?spot.high[2]:this.viewer.camera.target[2]}get step(){return this.viewer.camera.step(this.canvas.clientHeight)}seen(place2,z){
let{x,y,ahead}=this.page.seen([...place2,z]);return ahead?[x,y]:null}under(event,z){let box=this.canvas.getBoundingClientRect(),[x,y]=this.page.at(event.clientX-
box.left,event.clientY-box.top).level(z);return Number.isFinite(x+y)?[x,y]:null}points([x,y],reach){let{xyz,count}=this.viewer.scene.points,near=[];for(let at=0;at<
3*count;at+=3)Math.abs(xyz[at]-x)<reach&&Math.abs(xyz[at+1]-y)<reach&&near.push([xyz[at],xyz[at+1]]);return near}edges(id){let{xyz,building,lod,count}=this.viewer.
scene.edges,number=this.number(id)+1,own=[];for(let edge=0;edge<count;edge++)building[edge]===number&&own.push(edge);let finest=Math.max(...own.map(edge=>lod[edge]));
return own.filter(edge=>lod[edge]===finest).map(edge=>[0,3].map(end=>[0,1,2].map(axis=>xyz[6*edge+end+axis])))}show(shapes){this.sheet.replaceChildren(...shapes.
flatMap(({line,closed,at,text,z,kind,data})=>{let spots=(line||[at]).map(place2=>this.seen(place2,z));if(spots.some(spot=>!spot))return[];let one=document.createElementNS(
SVG,line?closed?"polygon":"polyline":text?"text":"circle"),[[x,y]]=spots,facts=line?{points:spots.map(spot=>spot.map(value=>value.toFixed(1)).join()).join(" ")}:
text?{x:x+10,y:y-10}:{cx:x,cy:y,r:7};for(let[name,value]of Object.entries({...facts,class:kind}))one.setAttribute(name,String(value));return Object.assign(one.dataset,
data),text&&(one.textContent=text),[one]}))}async replace({changed,gone}){for(let id of gone)this.number(id)>=0&&await this.page.replace(this.number(id),null);for(let{
row,arrays}of changed)await this.page.replace(this.number(row.id),arrays,row);this.draw()}};var{plans}=JSON.parse(byId("data").textContent).edit,LOOK_MS=4e3;async function call(name,words=null){let answer=await fetch(name,{method:"POST",headers:{"Conte\
nt-Type":"application/json"},body:JSON.stringify(words)}),content=await answer.json();if(!answer.ok)throw new Error(content.error);return content}var view,tools,
queue=[],place=-1,waiting=Promise.resolve(!0),say=(words,trouble=!1)=>{byId("said").textContent=words,byId("said").classList.toggle("trouble",trouble)};async function show(answer){
for(let id of answer.gone)delete plans[id];for(let{row,plan}of answer.changed)plans[row.id]=plan;await view.replace(answer);for(let entry of queue){let verdict=answer.
reviewed[entry.id];entry.reviewed=verdict?{date:"",verdict}:null}byId("undo").disabled=!answer.undo,byId("redo").disabled=!answer.redo,byId("edits").textContent=
answer.edits===1?"1 edit":`${answer.edits} edits`,answer.words.length&&say(answer.words.join("; "),!0),tools.draw(),list()}function change(name,words=null,done=""){
let began=performance.now();return document.documentElement.dataset.busy="yes",waiting=waiting.then(async()=>{try{say("…");let answer=await call(name,words);document.
documentElement.dataset.answered=((performance.now()-began)/1e3).toFixed(3),await show(answer);let seconds=(performance.now()-began)/1e3;return document.documentElement.
dataset.seconds=seconds.toFixed(3),answer.words.length||say(`${done||name}: ${seconds.toFixed(1)} s`),!0}catch(error){return say(error.message,!0),!1}finally{document.
documentElement.dataset.busy="no"}}),waiting}var act=action=>(byId("choices").replaceChildren(),change("act",action,action.verdict||action.do));function go(to){
if(!queue.length)return say("the queue is empty");place=Math.max(0,Math.min(queue.length-1,to));let{id,marks}=queue[place];tools.use(""),byId("choices").replaceChildren(),
tools.marks=marks,view.choose(id),tools.draw(),list()}function next(step=1){let to=place+step;for(;step>0&&to<queue.length&&queue[to].reviewed;)to++;if(to>=queue.
length)return say("no more of the queue is left");go(to)}async function right(){if(!view.chosen)return say("choose a building first");let of=queue[place]?.id===
view.chosen;await act({do:"right",id:view.chosen})&&of&&next()}function list(){let entry=queue[place],left=queue.filter(one=>!one.reviewed).length;byId("queue-p\
lace").textContent=entry?`${place+1} of ${queue.length}, ${left} left`:`${queue.length} to review, ${left} left`,byId("queue-reason").textContent=entry?`${entry.
id}: ${entry.reason}${entry.reviewed?` (${entry.reviewed.verdict})`:""}`:""}var state=verdict=>view.chosen?act({do:"state",id:view.chosen,verdict}):say("choose \
a building first");function height(verdict,column){let row=view.row(view.chosen),input=byId("height");if(!row)return say("choose a building first");input.dataset.
verdict=verdict,input.value=row[column]?.toFixed(2)??"",byId("height-label").textContent=verdict,byId("heights").hidden=!1,input.focus(),input.select()}async function choices(){
let id=view.chosen;if(!id)return say("choose a building first");say("three roofs …");try{let{choices:pictures}=await call("choices",{id});byId("choices").replaceChildren(
...Object.entries(pictures).map(([verdict,picture])=>{let button=document.createElement("button"),words=document.createElement("span");return button.type="butto\
n",button.innerHTML=String(picture),words.textContent=verdict,button.append(words),button.addEventListener("click",()=>{byId("choices").replaceChildren(),act({do:"\
state",id,verdict})}),button})),byId("choices").querySelector("button")?.focus(),say("choose a roof")}catch(error){say(error.message,!0)}}async function save(){
say("the files are written …"),document.documentElement.dataset.busy="yes";try{let{saved}=await call("save");say(saved),document.documentElement.dataset.saved=
"yes",location.reload()}catch(error){say(error.message,!0)}document.documentElement.dataset.busy="no"}var remove=()=>view.chosen?act({do:"delete",id:view.chosen}):
say("choose a building first"),KEYS={y:["right",right],j:["next",()=>next(1)],k:["back",()=>go(place-1)],x:["skip",()=>go(place+1)],c:["corners",()=>tools.use("\
corners")],d:["rectangle",()=>tools.use("rectangle")],g:["polygon",()=>tools.use("polygon")],v:["split",()=>tools.use("split")],b:["join",()=>tools.use("join")],
e:["carry on",()=>tools.use("carry")],Delete:["delete",remove],i:["ridge",()=>tools.use("ridge")],f:["one face",()=>tools.use("unite")],q:["dormer",()=>tools.use(
"dormer")],1:["coarser",()=>state("coarser roof")],2:["of points",()=>state("roof of points")],3:["finer",()=>state("finer roof")],w:["three roofs",choices],4:[
"flat",()=>state("flat roof")],5:["gable",()=>state("gable roof")],6:["hip",()=>state("hip roof")],7:["base height",()=>height("base height","h_ground")],8:["ea\
ves height",()=>height("eaves height","h_eaves")],u:["undo",()=>change("undo")],r:["redo",()=>change("redo")],F2:["save",save]};function listen(){for(let[key,[,
doIt]]of Object.entries(KEYS))document.querySelector(`[data-key="${key}"]`)?.addEventListener("click",doIt);document.addEventListener("keydown",event=>{if(event.
target.matches("input, select, textarea")||event.altKey)return;let undoing=event.ctrlKey||event.metaKey,known=tools.key(event);!known&&undoing&&"zZyY".includes(
event.key)?(change(event.key==="z"?"undo":"redo"),known=!0):!known&&!undoing&&KEYS[event.key]&&event.key!=="Enter"&&(KEYS[event.key][1](),known=!0),known&&(event.
preventDefault(),event.stopPropagation())},!0),byId("height").addEventListener("keydown",event=>{event.key==="Escape"&&(byId("heights").hidden=!0),event.key==="\
Enter"&&(byId("heights").hidden=!0,act({do:"state",id:view.chosen,verdict:byId("height").dataset.verdict,value:Number(byId("height").value)}),view.canvas.focus())})}
async function start(){view=await viewOf(),tools=new Tools(view,plans,act,say);let opened=await call("state");queue=opened.queue;let reviewed=Object.fromEntries(
queue.map(entry=>[entry.id,entry.reviewed]));await show(opened);for(let entry of queue)entry.reviewed=reviewed[entry.id]||entry.reviewed;listen(),list(),say("re\
ady"),document.documentElement.dataset.table="yes",document.documentElement.dataset.busy="no",setInterval(()=>{document.hidden||document.documentElement.dataset.
busy==="yes"||call("look").then(answer=>(answer.changed.length||answer.gone.length)&&show(answer).then(()=>say("another program changed edits: they are shown")),
()=>say("the server has ended; all is kept",!0))},LOOK_MS)}start().catch(error=>say(error.message,!0));})();
