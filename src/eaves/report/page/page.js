// made by `make page` of page/src efbf3fc20cde66af
"use strict";(()=>{var byId=name=>document.getElementById(name),field=name=>byId(name),source=globalThis.document?.getElementById("data"),page=source?JSON.parse(source.textContent??
""):{},element=(tag,attributes={},...children)=>{let made2=document.createElement(tag);for(let[name,value]of Object.entries(attributes))made2.setAttribute(name,
String(value));return made2.append(...children),made2};function figure(value,name=""){return value==null?"":typeof value!="number"||Number.isInteger(value)?String(
value):/_m[23]$/.test(name)?Number(value.toPrecision(4)).toLocaleString("en",{maximumFractionDigits:Math.abs(value)<100?1:0}):value.toFixed(2).replace(/^-0\.00$/,
"0.00")}var frameOf=name=>byId(name).parentElement,messageOf=error=>error instanceof Error?error.message:String(error);var LINES_MORE=12,HIDDEN="eaves.hidden-columns";function worstFirst(rows){let without2=row=>row.lod===null||row.lod===void 0,rank=row=>without2(row)?2:row.failure_code?
1:0,right=row=>without2(row)?0:row.trust_score??1,fit=row=>row.rmse_m??0;return rows.map((_,number)=>number).sort((one,two)=>right(rows[one])-right(rows[two])||
rank(rows[two])-rank(rows[one])||fit(rows[two])-fit(rows[one])||one-two)}function remembered(name,list){try{list&&localStorage.setItem(name,JSON.stringify(list));
let kept=JSON.parse(localStorage.getItem(name)??"[]");return Array.isArray(kept)?kept:[]}catch{return list??[]}}var Table=class{constructor(table,columns,rows,choose){
this.table=table,this.columns=columns,this.rows=rows,this.choose=choose,this.column=null,this.up=!0,this.order=worstFirst(rows),this.at=0,this.marked=-1,this.state=
"",this.box=table.parentElement,table.setAttribute("aria-rowcount",String(rows.length+1));let head=table.createTHead().insertRow();for(let column2 of columns){let button=element(
"button",{type:"button",title:page.meanings[column2.name]?.[1]||""},column2.title),cell=element("th",{scope:"col",class:this.kind(column2)},button);button.addEventListener(
"click",()=>this.sort(column2.name,cell)),head.append(cell)}let body=this.body=table.createTBody();this.broken=new Set(columns.map(({name})=>name).filter(name=>rows.
some(row=>typeof row[name]=="number"&&!Number.isInteger(row[name])))),this.keepWidths(),this.offerColumns(),this.over=element("div"),this.under=element("div"),table.
before(this.over),table.after(this.under);let of=event=>event.target.closest("tr[data-row]");body.addEventListener("click",event=>{let line=of(event);line&&choose(
Number(line.dataset.row))}),body.addEventListener("keydown",event=>this.key(event,of(event)));for(let name of["pointerover","focusin"])body.addEventListener(name,
event=>this.tell(of(event)));this.box.addEventListener("scroll",()=>this.fill()),new ResizeObserver(()=>this.fill()).observe(this.box),this.tall=28,this.fill(),
body.rows.length&&(this.tall=body.rows[0].getBoundingClientRect().height||this.tall),this.fill()}kind({name,number}){return`${name==="id"?"id ":""}${number?"num\
ber":"words"}`}text(row,{name}){let value=row[name];return Number.isInteger(value)&&this.broken.has(name)?figure(value+1e-9,name):figure(value,name)}keepWidths(){
let line=this.table.createTFoot().insertRow();line.setAttribute("aria-hidden","true");for(let column2 of this.columns){let longest="";for(let row of this.rows){
let text=this.text(row,column2);text.length>longest.length&&(longest=text)}line.append(element("td",{class:this.kind(column2)},longest))}}offerColumns(){let hidden=new Set(
remembered(HIDDEN)),style=element("style"),list=element("div",{}),hide=()=>{style.textContent=this.columns.map(({name},place)=>hidden.has(name)&&place?`#buildin\
gs :is(td, th):nth-child(${place+1}) { display: none; }`:"").join("")};for(let{name,title}of this.columns.slice(1)){let box=element("input",{type:"checkbox",...hidden.
has(name)?{}:{checked:""}});box.addEventListener("change",()=>{hidden[box.checked?"delete":"add"](name),remembered(HIDDEN,[...hidden]),hide()}),list.append(element(
"label",{},box,title))}hide(),this.box.before(element("details",{id:"columns"},element("summary",{},"Columns"),list),style)}line(place){let number=this.order[place],
row=this.rows[number],line=element("tr",{"data-row":number,"aria-rowindex":place+2,tabindex:place===this.at?"0":"-1",...number===this.marked?{"aria-current":"tr\
ue"}:{}});for(let column2 of this.columns)line.append(element("td",{class:this.kind(column2)},element("bdi",{},this.text(row,column2))));return line}fill(){let{
box,tall,order,body}=this,many=Math.ceil((box.clientHeight||430)/tall)+2*LINES_MORE,first=Math.max(0,Math.min(order.length-many,Math.floor(box.scrollTop/tall)-LINES_MORE)),
last=Math.min(order.length,first+many),state=[first,last,this.column,this.up,this.marked,this.at].join();if(state===this.state)return;let focused=body.contains(
document.activeElement);this.state=state,body.replaceChildren(...Array.from({length:last-first},(_,place)=>this.line(first+place))),this.over.style.height=`${first*
tall}px`,this.under.style.height=`${(order.length-last)*tall}px`,focused&&body.querySelector('tr[tabindex="0"]')?.focus({preventScroll:!0})}tell(line){byId("who\
le").textContent=[...line?.cells??[]].filter(cell=>cell.scrollWidth>cell.clientWidth).map(cell=>cell.textContent).join(" · ")}key(event,line){if(!line)return;let page2=Math.
max(1,Math.floor(this.box.clientHeight/this.tall)-2),last=this.order.length-1,step={ArrowDown:1,ArrowUp:-1,PageDown:page2,PageUp:-page2,Home:-last,End:last}[event.
key];if(event.key==="Enter"||event.key===" ")this.choose(Number(line.dataset.row));else if(step)this.go(Math.max(0,Math.min(last,Number(line.getAttribute("aria-\
rowindex"))-2+step)));else return;event.preventDefault()}go(place){let{box,tall}=this,head=this.table.tHead?.offsetHeight??0,top=place*tall;this.at=place,top<box.
scrollTop?box.scrollTop=top:top+tall+head>box.scrollTop+box.clientHeight&&(box.scrollTop=top+tall+head-box.clientHeight),this.fill()}sort(name,cell){this.up=this.
column===name?!this.up:!0,this.column=name;for(let other of this.table.tHead?.rows[0].cells??[])other.removeAttribute("aria-sort");cell.setAttribute("aria-sort",
this.up?"ascending":"descending");let missing=value=>value==null,{rows}=this;this.order.sort((one,two)=>{let a=rows[one][name],b=rows[two][name];return missing(
a)||missing(b)?Number(missing(a))-Number(missing(b))||one-two:(this.up?1:-1)*(a<b?-1:a>b?1:0)||one-two}),this.at=0,this.box.scrollTop=0,this.fill()}add(number){
this.order=[number,...this.order.map(other=>other+(other>=number?1:0))],this.update()}remove(number){this.order=this.order.filter(other=>other!==number),this.update()}update(){
this.state="",this.table.setAttribute("aria-rowcount",String(this.order.length+1)),this.fill()}mark(number){this.marked=number;let place=this.order.indexOf(number);
place>=0&&this.go(place),this.fill()}};var SETTINGS=[["lod","lod"],["points","point-colour"],["models","model-colour"],["size","size"],["swipe","swipe"]];function obeyAddress(viewer,hash=location.hash){
let given=new URLSearchParams(hash.slice(1)),theme=given.get("theme");theme&&(document.documentElement.dataset.theme=theme);for(let[name,control]of SETTINGS)given.
has(name)&&(field(control).value=given.get(name)??"");for(let[name,on]of[["on",!0],["off",!1]])for(let box of(given.get(name)||"").split(","))byId(box)&&(field(
box).checked=on);viewer.refresh();let wanted=given.get("building")??given.get("id");wanted==="worst"?viewer.choose(worstFirst(viewer.all)[0]??-1):wanted!==null&&
viewer.choose(viewer.all.findIndex(row=>row.id===wanted));for(let view of(given.get("view")||"").split(","))view&&viewer.view(view);let measured=(given.get("mea\
sure")||"").split(",").map(Number);if(measured.length>2&&measured.length%3===0&&measured.every(Number.isFinite)){viewer.ruler.toggle(!0);for(let place=0;place<measured.
length;place+=3)viewer.ruler.places.push(measured.slice(place,place+3));viewer.profile.toggle(given.has("profile"))}let eye=(given.get("eye")||"").split(",").map(
Number);if(eye.length===7&&eye.every(Number.isFinite)){let[azimuth,elevation,distance,flat,...target]=eye;Object.assign(viewer.camera,{azimuth,elevation,distance,
flat:flat===1,target}),viewer.ask()}}function addressOf(viewer){let{camera,look,all}=viewer,settings2=new URLSearchParams,theme=document.documentElement.dataset.
theme;theme&&settings2.set("theme",theme);for(let[name,control]of SETTINGS)field(control).value!==initial[control]&&settings2.set(name,field(control).value);let boxes=[
...document.querySelectorAll("#controls input[type=checkbox]")].filter(box=>box.checked!==box.defaultChecked);for(let[name,on]of[["on",!0],["off",!1]]){let ids=boxes.
filter(box=>box.checked===on).map(box=>box.id);ids.length&&settings2.set(name,ids.join())}look.chosen&&settings2.set("id",all[look.chosen-1].id),viewer.ruler.places.
length&&settings2.set("measure",viewer.ruler.places.flat().map(value=>value.toFixed(3)).join()),viewer.profile.on&&settings2.set("profile","1");let numbers=[camera.
azimuth,camera.elevation,camera.distance,camera.flat?1:0,...camera.target];return settings2.set("eye",numbers.map((value,place)=>Number(value.toFixed(place<2?4:
2))).join()),`#${settings2.toString().replaceAll("%2C",",")}`}var initial={};function keepAddress(viewer){for(let[,control]of SETTINGS)initial[control]=field(control).
value;if(location.protocol==="about:")return;let waiting,later=()=>{clearTimeout(waiting),waiting=setTimeout(()=>history.replaceState(null,"",addressOf(viewer)),
400)};for(let name of["pointerup","wheel","keyup","input"])byId("stage").addEventListener(name,later,{passive:!0});byId("buildings").addEventListener("click",later),
byId("theme").addEventListener("click",later)}var KINDS={uint8:Uint8Array,int16:Int16Array,uint16:Uint16Array,int32:Int32Array,uint32:Uint32Array};function inflate(data){let packed=Uint8Array.from(atob(data),
letter=>letter.charCodeAt(0));return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")))}async function unpackArray({type,
data}){let planes=new Uint8Array(await inflate(data).arrayBuffer()),width=KINDS[type].BYTES_PER_ELEMENT,count=planes.length/width,bytes2=new Uint8Array(planes.length);
for(let plane=0;plane<width;plane++)for(let item=0,from=plane*count,to=plane;item<count;item++,from++,to+=width)bytes2[to]=planes[from];return new KINDS[type](bytes2.
buffer)}async function unpackAll(packed){let names=Object.keys(packed),arrays=await Promise.all(names.map(name=>unpackArray(packed[name])));return Object.fromEntries(
names.map((name,place)=>[name,arrays[place]]))}async function unpackRows({names,data}){let columns=await inflate(data).json();return(columns[0]||[]).map((_,number)=>Object.
fromEntries(names.map((name,place)=>[name,columns[place][number]])))}var metres=whole=>Float32Array.from(whole,value=>value/1e3);var HANDLE=15,CHANGES={new:"#0a8f3c",demolished:"#d0302f",raised:"#7a3fd1",lowered:"#b8529e",extended:"#2f9fd0","partly demolished":"#e2711d","roof replaced":"#\
c79a00",unclear:"#6b7280","not covered":"#9aa4af",unchanged:"#d9d3c5"},Epochs=class{constructor(viewer){if(this.canvas=viewer.canvas,!!page.epochs){byId("epochs").
hidden=!1,page.epochs.forEach((name,place)=>{byId("divider").children[place].textContent=name}),byId("swipe").addEventListener("input",()=>viewer.ask());for(let way of[
"lod","type","fit","trust","failure"])document.querySelector(`#model-colour [value=${way}]`)?.remove();byId("model-colour").prepend(element("option",{value:"cha\
nge",selected:""},"change"))}}share(){let wide=this.canvas.clientWidth;return byId("divider").style.left=`calc(${HANDLE}px + (100% - ${2*HANDLE}px) * ${Number(field(
"swipe").value)/1e3})`,(HANDLE+(wide-2*HANDLE)*Number(field("swipe").value)/1e3)/wide}seenAt(x){let old=x<this.share()*this.canvas.clientWidth;return epoch=>!epoch||
epoch===1===old}};var CLASSES={0:["not used","#a7adb3"],1:["other","#8d9b6f"],2:["ground","#b59a74"],3:["low vegetation","#a6c36f"],4:["medium vegetation","#6ba14f"],5:["high veg\
etation","#3f7f3f"],6:["building","#8e1b2e"],7:["low noise","#e03fd8"],9:["water","#4f8fd0"],14:["wire","#d98c3f"],15:["tower","#8a5a2b"],17:["bridge","#9a7bb0"],
18:["high noise","#e03fd8"]},SET=["#4e79a7","#f28e2b","#59a14f","#b07aa1","#76b7b2","#edc948","#9c755f","#ff9da7","#8cd17d","#86bcb6"],LOD_COLOURS={"2.3":"#2f7f\
8f","2.2":"#4c9f70","2.0":"#9fc24d","1.3":"#e0b040","1.2":"#e07b39",0:"#8a8fa3",none:"#d23b3b"},TRUST_COLOURS={high:"#5b8c85",medium:"#f2c14e",low:"#c8102e",manual:"\
#6a51a3",none:"#8b8b8b"},VIRIDIS=["#440154","#3b528b","#21918c","#5ec962","#fde725"],DIVERGING=["#2f6fd6","#7fb0d8","#a9b5a4","#e39a6b","#d0302f"],CYCLE=["#e052\
4d","#d9c23f","#4dab5b","#3f7fd0","#e0524d"],NOTHING="#8b8b8b",bytes=colour=>[1,3,5].map(place=>parseInt(colour.slice(place,place+2),16));function ramp(colours){
let stops=colours.map(bytes),last=stops.length-1;return share=>{let place=Math.min(last-1e-6,Math.max(0,share*last)),low=Math.floor(place),part=place-low;return stops[low].
map((value,channel)=>Math.round(value+part*(stops[low+1][channel]-value)))}}function scaleOf(colours,low,high,unit,names){let at=ramp(colours),grey=bytes(NOTHING),
span=high>low?high-low:1;return{colour:value=>Number.isFinite(value)?at((value-low)/span):grey,legend:{colours,low,high,unit,names}}}function setOf(words2,known={}){
let table=new Map(words2.map((word,place)=>[word,known[word]||SET[place%SET.length]]));return{colour:word=>bytes(table.get(word)||NOTHING),legend:{words:[...table]}}}
function spread(values,lowest=.02,highest=.98){let finite=Float64Array.from(values).filter(Number.isFinite).sort();return finite.length?[finite[Math.floor(lowest*
(finite.length-1))],finite[Math.floor(highest*(finite.length-1))]]:[0,1]}var column=(rows,name)=>rows.map(row=>row[name]===null||row[name]===void 0?NaN:Number(row[name])),
words=(rows,name,missing)=>rows.map(row=>row[name]||missing),distinct=list=>[...new Set(list)].sort();function pointColours(way,{points,rows}){if(way==="height"){
let heights=spread(points.xyz.filter((_,place)=>place%3===2)),scale=scaleOf(VIRIDIS,heights[0],heights[1],"m");return scale.legend.shift=points.base,{at:number=>scale.
colour(points.xyz[3*number+2]),legend:scale.legend}}if(way==="building")return{at:number=>points.building[number]?bytes(SET[points.building[number]*7%SET.length]):
bytes(NOTHING),legend:{text:`${rows.length} buildings, a colour each; grey: none`}};if(way==="plane")return{at:number=>points.plane[number]?bytes(SET[points.plane[number]*
3%SET.length]):bytes(NOTHING),legend:{text:"neighbouring roof planes differ; grey: on no plane"}};if(way==="distance"){let scale=scaleOf(DIVERGING,-.3,.3,"m ove\
r the model’s roof");return{at:number=>scale.colour(points.distance[number]===32767?NaN:points.distance[number]/1e3),legend:scale.legend}}let there=distinct(points.
classification),table=there.map(code=>CLASSES[code]||[`class ${code}`,NOTHING]),colours=new Map(there.map((code,place)=>[code,bytes(table[place][1])]));return{at:number=>colours.
get(points.classification[number])??bytes(NOTHING),legend:{words:table}}}function modelColours(way,{triangles,rows}){if(way==="surface"){let scale2=setOf(["roof",
"wall","underside","ground"],{roof:"#cf6a50",wall:"#d9d3c5",underside:"#b08968",ground:"#8a8fa3"});return{at:number=>scale2.colour(["ground","wall","roof","unde\
rside"][triangles.kind[number]]),legend:scale2.legend}}if(way==="slope"){let scale2=scaleOf(VIRIDIS,0,60,"° of slope");return{at:number=>triangles.kind[number]===
2?scale2.colour(triangles.slope[number]):bytes("#f4f1ea"),legend:scale2.legend}}if(way==="azimuth"){let scale2=scaleOf(CYCLE,0,360,"",["N","E","S","W","N"]);return{
at:number=>triangles.kind[number]===2&&triangles.slope[number]>=2?scale2.colour(triangles.azimuth[number]):bytes("#f4f1ea"),legend:scale2.legend}}if(way==="fit"){
let scale2=scaleOf(["#3f9b6a","#e7d04a","#d23b3b"],0,.5,"m RMSE of each roof face; grey: no points"),side=bytes("#f4f1ea");return{at:number=>triangles.kind[number]===
2?scale2.colour(triangles.error[number]===65535?NaN:triangles.error[number]/1e3):side,legend:scale2.legend}}let name={change:"change",lod:"lod",type:"roof_type",
failure:"failure_code",trust:"trust"}[way]??way,values=words(rows,name,way==="failure"?"as asked for":"none"),known={"as asked for":"#7fa98f",none:LOD_COLOURS.none};
for(let{lod,failure_code:code}of rows)way==="failure"&&code&&(!lod||lod==="0")&&(known[code]=LOD_COLOURS.none);let inOrder=way==="trust"?Object.keys(TRUST_COLOURS).
filter(word=>values.includes(word)):way==="lod"?[...page.lods].reverse().concat("none").filter(word=>values.includes(word)):distinct(values),scale=setOf(inOrder,
{change:CHANGES,lod:LOD_COLOURS,trust:TRUST_COLOURS}[way]||known);return{at:(_,row)=>scale.colour(values[row]),legend:scale.legend}}function legend(box,{words:words2,
colours,low=0,high=0,unit,text,names,shift=0}){box.replaceChildren(),text&&box.append(text);for(let[word,colour]of words2||[])box.append(element("span",{class:"\
key"},element("i",{style:`background:${colour}`}),word));if(colours){let ends=names||[low,high].map(value=>(value+shift).toFixed(Math.abs(high-low)<2?1:0).replace(
/^-(0(\.0)?)$/,"$1"));box.append(element("span",{class:"ramp",style:`background:linear-gradient(90deg,${colours})`}),element("span",{class:"ends"},...ends.map(end=>element(
"span",{},end))),unit||"")}}function bars(title,entries,note=""){let most=Math.max(1,...entries.map(([,count])=>count)),list=element("ol",{class:"bars"});for(let[label,count]of entries){let bar=element(
"span",{class:"bar",style:`height:${count?Math.max(2,110*count/most):0}px`});list.append(element("li",{title:`${label}: ${count}`},element("span",{class:"count"},
count?String(count):""),bar,element("span",{class:"label"},label)))}return element("figure",{},element("figcaption",{},title," ",element("small",{},note)),list)}
function histogram(title,values,width,top,unit,note=""){let known=values.filter(Number.isFinite),count=Math.round(top/width),bins=new Array(count+1).fill(0);for(let value of known)
bins[Math.min(count,Math.floor(value/width+1e-9))]++;let digits=width<.1?2:1,label=place=>place===count?`${top}+`:(place*width).toFixed(digits);return bars(title,
bins.map((number,place)=>[label(place),number]),`${unit}${note}`)}function tally(title,words2){let counts=new Map;for(let word of words2)counts.set(word,(counts.
get(word)||0)+1);return bars(title,[...counts].sort((one,two)=>two[1]-one[1]))}function drawCharts(box,rows){if(page.epochs)return box.append(tally("Changes",words(
rows,"change","")),tally("Certainty",words(rows,"certainty","none")));box.append(histogram("Fit of the models",column(rows,"rmse_m"),.05,.5,"RMSE, m")),rows.some(
row=>row.rmse95_m!==void 0)&&box.append(histogram("Fit without the worst 5 %",column(rows,"rmse95_m"),.05,.5,"RMSE, m")),box.append(tally("Level of detail reach\
ed",words(rows,"lod","no model"))),box.append(tally("Roof types",words(rows,"roof_type","none")));let failed=rows.filter(row=>row.failure_code);box.append(tally(
`Failures and coarser models: ${failed.length||"none"}`,words(failed,"failure_code","")))}function describe(box,row,number,{points,rows}){let list=element("dl"),
{id,change,certainty,reason,trust,trust_score,review_reason,...others}=row;for(let[name,value]of Object.entries({id,change,certainty,reason,trust,trust_score,review_reason,
...others}))value!=null&&name!=="number"&&list.append(element("dt",{title:page.meanings[name]?.[1]||""},page.meanings[name]?.[0]||name),element("dd",{},figure(value,
name)));if(number>=rows.length){box.replaceChildren(element("h2",{},row.id),list,element("p",{},`Not drawn: the page shows ${rows.length.toLocaleString("en")} b\
uildings. `,...page.epochs?[]:[element("code",{},`eaves view OUT --around ${row.id}`)," makes a page around this one."]));return}let distances=[],mine=0;for(let place=0;place<
points.count;place++)points.building[place]===number+1&&(mine++,points.distance[place]!==32767&&distances.push(Math.abs(points.distance[place])/1e3));distances.
sort((one,two)=>one-two);let parts=[element("h2",{},row.id),list,element("p",{},`${mine.toLocaleString("en")} of its points are drawn, ${distances.length.toLocaleString(
"en")} over its roof`+(distances.length?`; median distance ${distances[Math.floor(distances.length/2)].toFixed(3)} m`:""))];distances.length&&parts.push(histogram(
"Distances to the roof",distances,.05,.5,"m")),box.replaceChildren(...parts)}var QUALITIES=[{scale:1,smooth:!0,points:1/0,ground:0,lines:!0,detail:0},{scale:1,smooth:!1,points:12e4,ground:1,lines:!0,detail:1},{scale:.7,smooth:!1,points:4e4,
ground:2,lines:!0,detail:2},{scale:.5,smooth:!1,points:15e3,ground:3,lines:!1,detail:2},{scale:.35,smooth:!1,points:8e3,ground:3,lines:!1,detail:2}],LONG=45,SHORT=22,
REST=160,Pace=class{constructor(painter,before,after){this.painter=painter,this.before=before,this.after=after,this.quality=this.asked=this.painted=this.easy=0,
this.running=!1,this.wake=()=>{}}async first(){for(;!this.painted;)await new Promise(requestAnimationFrame)}ask(){this.asked++,this.wake(),document.documentElement.
dataset.still="no",this.running||this.run()}async run(){this.running=!0;for(let answered=0,shown=0;answered!==this.asked||shown>0;)if(await new Promise(requestAnimationFrame),
answered!==this.asked){answered=this.asked,shown=this.quality;let first=!this.painted,milliseconds=await this.paint(QUALITIES[shown]);this.adapt(first?await this.
paint(QUALITIES[shown]):milliseconds),this.after(shown),shown&&await this.rest(answered)}else await this.paintWhole(answered)&&this.after(shown=0);this.running=
!1,document.documentElement.dataset.still="yes"}async paint(quality){let began=performance.now(),{painter}=this;return painter.begin(...this.before(),quality),painter.
pieces(quality).forEach(piece=>painter.draw(piece)),painter.present(),await painter.finished(),this.painted++||performance.mark("picture"),performance.now()-began}async paintWhole(answered){
let{painter}=this,[quality]=QUALITIES;painter.begin(...this.before(),quality);for(let piece of painter.pieces(quality))if(painter.draw(piece),await painter.finished(),
this.asked!==answered)return!1;return painter.present(),await painter.finished(),!0}adapt(milliseconds){let last=QUALITIES.length-1;milliseconds>8*LONG?this.quality=
Math.max(this.quality,last-1):milliseconds>LONG&&(this.quality=Math.min(last,this.quality+1)),this.easy=milliseconds<SHORT?this.easy+1:0,this.easy>12&&this.quality>
0&&([this.quality,this.easy]=[this.quality-1,0])}rest(answered){return new Promise(done=>{this.wake=done,this.asked===answered?setTimeout(done,REST):done()})}};function roofHeights({rows,columns,cell,west,north,epoch},{xyz,kind,epochs,count}){let heights=new Float32Array(rows*columns).fill(-1/0);for(let number=0,at=0;number<
count;number++,at+=9){if(kind[number]===1||epochs[number]!==epoch)continue;let[x,y,z]=[0,1,2].map(axis=>[xyz[at+axis],xyz[at+3+axis],xyz[at+6+axis]]),across=x.map(
value=>(value-west)/cell-.5),down=y.map(value=>(north-value)/cell-.5),top=Math.max(...z),size=(across[1]-across[0])*(down[2]-down[0])-(across[2]-across[0])*(down[1]-
down[0]);if(size)for(let row=Math.max(0,Math.ceil(Math.min(...down)));row<=Math.min(rows-1,Math.max(...down));row++)for(let column2=Math.max(0,Math.ceil(Math.min(
...across)));column2<=Math.min(columns-1,Math.max(...across));column2++){let one=((column2-across[0])*(down[2]-down[0])-(across[2]-across[0])*(row-down[0]))/size,
two=((across[1]-across[0])*(row-down[0])-(column2-across[0])*(down[1]-down[0]))/size,place=row*columns+column2;one>=0&&two>=0&&one+two<=1&&top>heights[place]&&(heights[place]=
top)}}return heights}function groundShade(terrain,triangles){let{rows,columns,cell,heights}=terrain,tops=roofHeights(terrain,triangles),bright=new Float32Array(
rows*columns).fill(1),ways=[[0,1],[1,1],[1,0],[1,-1],[0,-1],[-1,-1],[-1,0],[-1,1]],steps=[1,2,3,5,8];for(let row=0,place=0;row<rows;row++)for(let column2=0;column2<
columns;column2++,place++){let sky=0;for(let[down,across]of ways){let steepest=0;for(let step of steps){let i=row+step*down,j=column2+step*across;if(i<0||j<0||i>=
rows||j>=columns)break;let rise=Math.max(tops[i*columns+j],heights[i*columns+j]<1e6?heights[i*columns+j]:-1/0)-heights[place];steepest=Math.max(steepest,rise/(step*
cell*Math.hypot(down,across)))}sky+=1/(1+steepest*steepest)}bright[place]=.5+(1-.5)*sky/ways.length}return bright}function pointsOverRoofs({xyz,epochs,count},triangles){
let low=[1/0,1/0],high=[-1/0,-1/0],over=new Uint8Array(count);for(let place=0;place<triangles.xyz.length;place+=3)for(let axis of[0,1])low[axis]=Math.min(low[axis],
triangles.xyz[place+axis]),high[axis]=Math.max(high[axis],triangles.xyz[place+axis]);if(!(high[0]>low[0]&&high[1]>low[1]))return over;let cell=Math.max(.5,Math.
sqrt((high[0]-low[0])*(high[1]-low[1])/4e6)),[west,north]=[low[0],high[1]],columns=Math.ceil((high[0]-low[0])/cell),rows=Math.ceil((high[1]-low[1])/cell),tops=new Map(
[...new Set(epochs)].map(epoch=>[epoch,roofHeights({rows,columns,cell,west,north,epoch},triangles)]));for(let number=0;number<count;number++){let column2=Math.floor(
(xyz[3*number]-west)/cell),row=Math.floor((north-xyz[3*number+1])/cell);over[number]=column2>=0&&row>=0&&column2<columns&&row<rows&&(tops.get(epochs[number])??[])[row*
columns+column2]>-1/0?1:0}return over}var wallShade=over=>.74+(1-.74)*Math.min(1,Math.max(0,over/6));function readScene(arrays,terrain=page.terrain){let order=shuffled(arrays.point_class.length),mixed=(values,width)=>reordered(values,order,width),points={xyz:metres(
mixed(arrays.point_xyz,3)),epochs:mixed(epochsOf(arrays.point_epoch,order.length),1),classification:mixed(arrays.point_class,1),building:mixed(arrays.point_building,
1),plane:mixed(arrays.point_plane,1),distance:mixed(arrays.point_distance,1),count:order.length,base:page.base},shapes=readShapes(arrays),grounds=readGrounds(arrays.
terrain,terrain,shapes.triangles);return{...shapes,points:{...points,over:pointsOverRoofs(points,shapes.triangles)},grounds}}function readShapes(arrays){let triangles={
xyz:metres(arrays.triangle_xyz),building:arrays.triangle_building,lod:arrays.triangle_lod,epochs:epochsOf(arrays.triangle_epoch,arrays.triangle_lod.length),kind:arrays.
triangle_kind,error:arrays.triangle_error,count:arrays.triangle_lod.length},edges={xyz:metres(arrays.edge_xyz),building:arrays.edge_building,lod:arrays.edge_lod,
epochs:epochsOf(arrays.edge_epoch,arrays.edge_lod.length),count:arrays.edge_lod.length},prints={xyz:metres(arrays.outline_xyz),building:arrays.outline_building,
epochs:epochsOf(arrays.outline_epoch,arrays.outline_building.length),count:arrays.outline_building.length};return{triangles:{...triangles,...slopes(triangles)},
edges,prints}}var epochsOf=(values,count)=>values||new Uint8Array(count);function readGrounds(whole,terrain,triangles){let heights=metres(whole),cells=terrain.rows*
terrain.columns;return(page.epochs?[1,2]:[0]).map((epoch,place)=>{let grid={...terrain,epoch,heights:heights.subarray(place*cells,(place+1)*cells)};return{...terrainMesh(
grid),light:groundShade(grid,triangles)}})}function joined(scenes){if(scenes.length===1)return scenes[0];let join=name=>joinThings(scenes.map(scene=>scene[name]));
return{points:join("points"),triangles:join("triangles"),edges:join("edges"),prints:join("prints"),grounds:scenes.flatMap(scene=>scene.grounds)}}function joinThings(parts){
return Object.fromEntries(Object.entries(parts[0]).map(([name,first])=>{if(name==="count")return[name,parts.reduce((sum,part)=>sum+part.count,0)];if(!ArrayBuffer.
isView(first))return[name,first];let all=new first.constructor(parts.reduce((sum,part)=>sum+part[name].length,0)),place=0;for(let part of parts)all.set(part[name],
place),place+=part[name].length;return[name,all]}))}function without(things,building){let runs=[],count=0;for(let number=0,begun=0;number<=things.count;number++)
number<things.count&&things.building[number]!==building||(number>begun&&runs.push([begun,number]),count+=number-begun,begun=number+1);return Object.fromEntries(
Object.entries(things).map(([name,values])=>{if(name==="count")return[name,count];if(!ArrayBuffer.isView(values))return[name,values];let all=values,width=all.length/
Math.max(1,things.count),out=new all.constructor(width*count),place=0;for(let[from,to]of runs)out.set(all.subarray(width*from,width*to),place),place+=width*(to-
from);return[name,out]}))}function shuffled(count){let order=Uint32Array.from({length:count},(_,place)=>place);for(let place=count-1,state=1;place>0;place--){state=
Math.imul(state,1664525)+1013904223>>>0;let other=Math.floor(state/2**32*(place+1)),kept=order[place];order[place]=order[other],order[other]=kept}return order}function reordered(values,order,width){
let out=new values.constructor(width*order.length);for(let place=0;place<order.length;place++)for(let k=0;k<width;k++)out[width*place+k]=values[width*order[place]+
k];return out}function slopes({xyz,count}){let slope=new Float32Array(count),azimuth=new Float32Array(count);for(let number=0,at=0;number<count;number++,at+=9){
let ux=xyz[at+3]-xyz[at],uy=xyz[at+4]-xyz[at+1],uz=xyz[at+5]-xyz[at+2],vx=xyz[at+6]-xyz[at],vy=xyz[at+7]-xyz[at+1],vz=xyz[at+8]-xyz[at+2],east=uy*vz-uz*vy,north=uz*
vx-ux*vz,up=ux*vy-uy*vx;slope[number]=Math.acos(Math.min(1,Math.abs(up)/(Math.hypot(east,north,up)||1)))*180/Math.PI,azimuth[number]=(Math.atan2(east,north)*180/
Math.PI+360)%360}return{slope,azimuth}}var repeated=(numbers,times)=>{let out=new Uint32Array(numbers.length*times);for(let place=0;place<out.length;place++)out[place]=
numbers[Math.floor(place/times)];return out};function terrainMesh({rows,columns,cell,west,north,heights,epoch}){let position=new Float32Array(3*rows*columns),missing=place=>heights[place]>
1e6;for(let row=0,place=0;row<rows;row++)for(let column2=0;column2<columns;column2++,place++)position.set([west+(column2+.5)*cell,north-(row+.5)*cell,missing(place)?
0:heights[place]],3*place);let stops=(count,step)=>[...new Set([...Array(Math.ceil(count/step)).keys()].map(k=>k*step).concat(Math.max(0,count-1)))],details=[1,
2,4,8].map(step=>{let indices=[],down=stops(rows,step),along=stops(columns,step);for(let i=0;i+1<down.length;i++)for(let j=0;j+1<along.length;j++){let[a,b,c,d]=[
down[i]*columns+along[j],down[i+1]*columns+along[j],down[i]*columns+along[j+1],down[i+1]*columns+along[j+1]];!missing(a)&&!missing(b)&&!missing(c)&&!missing(d)&&
indices.push(a,b,c,c,b,d)}return Uint32Array.from(indices)});return{position,details,epoch}}function boxOf(scene){let low=[1/0,1/0,1/0],high=[-1/0,-1/0,-1/0],grow=xyz=>{
for(let place=0;place<xyz.length;place++)low[place%3]=Math.min(low[place%3],xyz[place]),high[place%3]=Math.max(high[place%3],xyz[place])};for(let ground of scene.
grounds)grow(ground.position);return grow(scene.triangles.xyz),Number.isFinite(low[0])||grow(scene.points.xyz),Number.isFinite(low[0])?{low,high}:{low:[-5,-5,-5],
high:[5,5,5]}}var modelOf=({building,epochs},number)=>3*building[number]+epochs[number];function spotsOf({prints,triangles,rows}){let spots=rows.map(()=>({low:[
1/0,1/0,1/0],high:[-1/0,-1/0,-1/0]})),grow=(xyz,building,width)=>{for(let place=0;place<xyz.length;place++){let spot=spots[building[Math.floor(place/width)]-1],
axis=place%3;spot.low[axis]=Math.min(spot.low[axis],xyz[place]),spot.high[axis]=Math.max(spot.high[axis],xyz[place])}};return grow(prints.xyz,prints.building,6),
grow(triangles.xyz,triangles.building,9),spots}var BOX=255,NEAR=1500,NEAR_BUILDINGS=4e3,SQUARES_KEPT=40,SUNK=4,CELLS=[30,60,120,240],HOUSE=15,PART=3,TRIANGLES_OF_BOX=10,ROOF_OF_BOX=8,NO_TRIANGLES={xyz:new Float32Array(
0),kind:new Uint8Array(0),epochs:new Uint8Array(0),count:0},settings=()=>page.city,fetched=async name=>{let answer=await fetch(`${settings().folder}/${name}.jso\
n`);if(!answer.ok)throw new Error(`${name}.json: the server answers with status ${answer.status}`);return answer.json()},City=class _City{constructor(boxes){this.
rows=Array.from(boxes.box_lod,()=>({id:""})),this.squares=settings().squares,this.scenes=new Map,this.near=[],this.busy=!1,this.viewer=null,this.corners=metres(
boxes.box_xy),this.heights=metres(boxes.box_z),this.lods=boxes.box_lod,this.square=boxes.box_square,this.grounds=readGrounds(boxes.terrain,page.terrain,NO_TRIANGLES),
this.order=this.rows.map((_,number)=>number).sort((one,two)=>this.square[one]-this.square[two]||one-two),this.boxed=this.order,this.levels=CELLS.map(side=>this.
roofs(side)),this.far=joinThings(this.levels)}roofs(side){let{corners,heights,square,squares,order}=this,first=[0],cells=[];for(let number=0,at=0;number<squares.
length;number++){let[west,south]=squares[number],there=new Map;for(;at<order.length&&square[order[at]]===number;at++){let building2=order[at],from=8*building2,[
x,y]=[0,1].map(axis=>(corners[from+axis]+corners[from+4+axis])/2),area=Math.max(1,Math.abs((corners[from+2]-corners[from])*(corners[from+7]-corners[from+1])-(corners[from+
3]-corners[from+1])*(corners[from+6]-corners[from]))),key=Math.floor((x-west)/side)+1e3*Math.floor((y-south)/side),cell=there.get(key)??{x:0,y:0,z:0,area:0,most:0,
building:building2};area>cell.most&&Object.assign(cell,{most:area,building:building2});for(let[name,value]of[["x",x],["y",y],["z",heights[2*building2+1]]])cell[name]+=
area*value;cell.area+=area,there.set(key,cell)}cells.push(...there.values()),first.push(2*cells.length)}let count=2*cells.length,xyz=new Float32Array(9*count),building=new Uint32Array(
count);return cells.forEach((cell,place)=>{let from=8*cell.building,middle=[0,1].map(axis=>(corners[from+axis]+corners[from+4+axis])/2),grown=Math.sqrt(cell.area/
cell.most);[0,1,2,0,2,3].forEach((corner,vertex)=>{let[x,y]=[0,1].map(axis=>grown*(corners[from+2*corner+axis]-middle[axis]));xyz.set([cell.x/cell.area+x,cell.y/
cell.area+y,cell.z/cell.area],18*place+3*vertex)}),building.fill(cell.building+1,2*place,2*place+2)}),{xyz,building,epochs:new Uint8Array(count),count,first}}roofOf(){
let roof=new Uint32Array(this.rows.length);return this.boxed.forEach((number,place)=>{roof[number]=TRIANGLES_OF_BOX*place+ROOF_OF_BOX}),roof}blocks(models,far,roofs){
let{boxed,square,squares,corners,heights,levels}=this,boxes=3*TRIANGLES_OF_BOX*boxed.length,blocks=[],starts=models.drawn.map(list=>{let start2=new Uint32Array(
squares.length+2);for(let place=0;place<list.numbers.length;place+=3)start2[1+(list.numbers[place]<boxes?square[boxed[Math.floor(list.numbers[place]/(3*TRIANGLES_OF_BOX))]]:
squares.length)]+=3;for(let number=1;number<start2.length;number++)start2[number]+=start2[number-1];return start2}),rangeOf=(which,number)=>({layer:models,list:models.
drawn[which],first:starts[which][number],count:starts[which][number+1]-starts[which][number]});for(let at=0;at<boxed.length;){let number=square[boxed[at]],low=[
1/0,1/0,1/0],high=[-1/0,-1/0,-1/0];for(;at<boxed.length&&square[boxed[at]]===number;at++)for(let corner=0;corner<4;corner++)for(let level of[0,1])[corners[8*boxed[at]+
2*corner],corners[8*boxed[at]+2*corner+1],heights[2*boxed[at]+level]].forEach((value,axis)=>{low[axis]=Math.min(low[axis],value),high[axis]=Math.max(high[axis],
value)});let ways=[{...rangeOf(0,number),size:PART},{...rangeOf(1,number),size:HOUSE}],before=0;for(let[level,{first,count}]of levels.entries())roofs&&ways.push(
{layer:far,list:far.drawn[0],first:3*(before+first[number]),count:3*(first[number+1]-first[number]),size:CELLS[level]}),before+=count;blocks.push({low,high,ways})}
return[...blocks,{low:[],high:[],ways:[{...rangeOf(0,squares.length),size:1/0}]}]}static async open(){if(location.protocol==="file:")throw new Error("this page \
is one of a web server; eaves view OUT --serve is one");return new _City(await unpackAll((await fetched("boxes")).arrays))}boxes(near){let{corners,heights,lods,
square}=this,there=new Set(near),far=this.boxed=this.order.filter(number=>!there.has(square[number])),count=TRIANGLES_OF_BOX*far.length,xyz=new Float32Array(9*count),
building=new Uint32Array(count),lod=new Uint8Array(count),kind=new Uint8Array(count).fill(1),slope=new Float32Array(count).fill(90),at=0,face=0;for(let number of far){
let[low,high]=[heights[2*number],heights[2*number+1]],put=(corner,z)=>{xyz[at++]=corners[8*number+2*corner],xyz[at++]=corners[8*number+2*corner+1],xyz[at++]=z};
for(let one=0;one<4;one++){let two=(one+1)%4;put(one,low),put(two,low),put(two,high),put(one,low),put(two,high),put(one,high)}put(0,high),put(1,high),put(2,high),
put(0,high),put(2,high),put(3,high),building.fill(number+1,face,face+TRIANGLES_OF_BOX),lod.fill(lods[number]?BOX:0,face,face+TRIANGLES_OF_BOX),kind.fill(2,face+
ROOF_OF_BOX,face+TRIANGLES_OF_BOX),slope.fill(0,face+ROOF_OF_BOX,face+TRIANGLES_OF_BOX),face+=TRIANGLES_OF_BOX}let bare=()=>({xyz:new Float32Array(0),building:new Uint32Array(
0),epochs:new Uint8Array(0),count:0}),points={...bare(),classification:new Uint8Array(0),plane:new Uint8Array(0),distance:new Int16Array(0),over:new Uint8Array(
0),base:page.base},triangles={xyz,building,lod,kind,slope,azimuth:new Float32Array(count),epochs:new Uint8Array(count),error:new Uint16Array(count).fill(65535),
count};return{points,triangles,edges:{...bare(),lod:new Uint8Array(0)},prints:bare(),grounds:this.grounds.map(ground=>({...ground,position:this.sunk(ground.position,
near)}))}}sunk(position,near){let lower=position.slice();for(let number of near){let[west,south,east,north]=this.squares[number];for(let at=0;at<lower.length;at+=
3)lower[at]>west&&lower[at]<east&&lower[at+1]>south&&lower[at+1]<north&&(lower[at+2]-=SUNK)}return lower}scene(){return{...joined([this.boxes(this.near),...this.
near.map(number=>this.scenes.get(number))]),rows:this.rows,far:this.far}}wanted({distance,target:[x,y]}){if(distance>NEAR)return[];let away=([west,south,east,north])=>Math.
hypot(Math.max(west-x,0,x-east),Math.max(south-y,0,y-north)),order=this.squares.map((square,number)=>[away(square),number,square[4]]).filter(([far])=>far<Math.max(
200,.8*distance)).sort((one,two)=>one[0]-two[0]),count=0;return order.filter(([,,buildings],place)=>(count+=buildings)<=NEAR_BUILDINGS||!place).map(([,number])=>number).
sort((one,two)=>one-two)}async follow(viewer){this.viewer=viewer,viewer.city=this,viewer.pace.quality=QUALITIES.length-2,viewer.refresh(),await viewer.pace.first(),
(await unpackRows(await fetched("rows"))).forEach((row,number)=>{this.rows[number]=row})}async look(){let{viewer}=this;if(!viewer)return;let near=this.wanted(viewer.
camera);if(!(this.busy||near.join()===this.near.join())){this.busy=!0,document.documentElement.dataset.near="no";try{await Promise.all(near.filter(number=>!this.
scenes.has(number)).map(async number=>{let{terrain,arrays}=await fetched(number);this.scenes.set(number,readScene(await unpackAll(arrays),terrain))})),this.near=
near;for(let number of this.scenes.keys())this.scenes.size>SQUARES_KEPT&&!near.includes(number)&&this.scenes.delete(number);viewer.load(this.scene()),viewer.refresh(),
viewer.profile.draw(),viewer.look.chosen&&viewer.describe(viewer.look.chosen-1)}catch(error){byId("answer").textContent=`Not all is here: ${messageOf(error)}.`}
this.busy=!1,document.documentElement.dataset.near="yes"}}};var STEEPEST=Math.PI/2-1e-4,Camera=class{azimuth=0;elevation=.8;distance=1;flat=!1;size=1;wide=1;deep=1;target=[0,0,0];constructor(box,aspect){this.box=box,this.
aspect=aspect,this.reset()}reset(){let{low,high}=this.box;this.target=low.map((value,axis)=>(value+high[axis])/2),this.size=Math.max(10,Math.hypot(high[0]-low[0],
high[1]-low[1])),this.wide=high[0]-low[0],this.deep=high[1]-low[1],this.flat=!1;let tries=[-.35,-.35-Math.PI/2].map(azimuth=>(Object.assign(this,{distance:1.36*
this.size,azimuth,elevation:.8,target:low.map((value,axis)=>(value+high[axis])/2)}),this.fit(),{azimuth,distance:this.distance,target:this.target}));Object.assign(
this,tries[1].distance<.85*tries[0].distance?tries[1]:tries[0])}fit(){let{low,high}=this.box,tall=Math.tan(.7/2),axes=this.axes();for(let round=0;round<8;round++){
let least=[1/0,1/0],most=[-1/0,-1/0];for(let corner=0;corner<8;corner++){let away=this.target.map((value,axis)=>(corner>>axis&1?high:low)[axis]-value),[x,y,z]=[
axes.right,axes.up,axes.back].map(axis=>axis[0]*away[0]+axis[1]*away[1]+axis[2]*away[2]),depth=Math.max(.05*this.distance,this.distance-z);[x/(depth*tall*this.aspect),
y/(depth*tall)].forEach((place,axis)=>{least[axis]=Math.min(least[axis],place),most[axis]=Math.max(most[axis],place)})}let[right,up]=[0,1].map(axis=>(least[axis]+
most[axis])/2*this.distance*tall*(axis?1:this.aspect));this.target=this.target.map((value,axis)=>value+right*axes.right[axis]+up*axes.up[axis]),this.distance=Math.
max(10,this.distance*Math.max((most[0]-least[0])/1.94,(most[1]-least[1])/1.84))}}above(all){Object.assign(this,{azimuth:0,elevation:STEEPEST,flat:!0}),all&&(this.
distance=1.06*Math.max(this.deep,this.wide/this.aspect)/(2*Math.tan(.7/2)))}side(quarter=0){Object.assign(this,{azimuth:quarter*Math.PI/2,elevation:.02,flat:!0})}turn(right,up){
this.azimuth+=right,this.elevation=Math.min(STEEPEST,Math.max(-.3,this.elevation+up))}zoom(factor){this.distance=Math.min(20*this.size,Math.max(2,this.distance*
factor))}step(height){return 2*this.distance*Math.tan(.7/2)/height}axes(){let[sin,cos]=[Math.sin(this.azimuth),Math.cos(this.azimuth)],[up,level]=[Math.sin(this.
elevation),Math.cos(this.elevation)];return{right:[cos,sin,0],up:[-sin*up,cos*up,level],back:[sin*level,-cos*level,up]}}pan(right,down,height){let step=this.step(
height),axes=this.axes(),level=this.elevation<.35?axes.up:[-Math.sin(this.azimuth),Math.cos(this.azimuth),0];this.target=this.target.map((value,axis)=>value-step*
right*axes.right[axis]+step*down*level[axis])}eye(){let{back}=this.axes();return this.target.map((value,axis)=>value+this.distance*back[axis])}matrix(aspect){let{
right,up,back}=this.axes(),eye=this.eye(),move=[right,up,back].map(axis=>-(axis[0]*eye[0]+axis[1]*eye[1]+axis[2]*eye[2])),near=Math.max(.1,this.distance/100),far=this.
distance+4*this.size,tall=Math.tan(.7/2),out=new Float32Array(16);for(let column2=0;column2<4;column2++){let[x,y,z]=[right,up,back].map((axis,row)=>column2<3?axis[column2]:
move[row]),last=column2===3?1:0;if(this.flat){let reach=4*this.size+this.distance;out.set([x/(tall*aspect*this.distance),y/(tall*this.distance),-z/reach,last],4*
column2),last&&(out[14]=(-z-this.distance)/reach)}else out.set([x/(tall*aspect),y/tall,(-(far+near)*z-2*far*near*last)/(far-near),-z],4*column2)}return out}flyTo(center,radius){
this.target=[...center],this.distance=Math.max(25,3.2*radius),this.flat||(this.elevation=Math.max(.35,Math.min(this.elevation,1.1)))}};var NEAR_ENOUGH=4;function sightOf(camera,width,height,x,y){let{right,up,back}=camera.axes(),eye=camera.eye(),tall=Math.tan(.7/2),dot=(axis,px,py,pz)=>axis[0]*(px-
eye[0])+axis[1]*(py-eye[1])+axis[2]*(pz-eye[2]),seen=(px,py,pz)=>{let depth=-dot(back,px,py,pz),step=2*(camera.flat?camera.distance:depth)*tall/height;return{aside:dot(
right,px,py,pz)/step+width/2-x,down:height/2-dot(up,px,py,pz)/step-y,depth,ahead:camera.flat||depth>0}},[across,over]=[(x-width/2)*2*tall/height,(height/2-y)*2*
tall/height],bent=axis=>right[axis]*across+up[axis]*over,axes=[0,1,2];return camera.flat?{seen,from:axes.map(axis=>eye[axis]+camera.distance*bent(axis)),along:back.
map(value=>-value)}:{seen,from:eye,along:axes.map(axis=>bent(axis)-back[axis])}}function hitTriangle(xyz,at,[fx,fy,fz],[dx,dy,dz]){let ax=xyz[at],ay=xyz[at+1],az=xyz[at+
2],ux=xyz[at+3]-ax,uy=xyz[at+4]-ay,uz=xyz[at+5]-az,vx=xyz[at+6]-ax,vy=xyz[at+7]-ay,vz=xyz[at+8]-az,px=dy*vz-dz*vy,py=dz*vx-dx*vz,pz=dx*vy-dy*vx,size=ux*px+uy*py+
uz*pz;if(Math.abs(size)<1e-12)return 1/0;let tx=fx-ax,ty=fy-ay,tz=fz-az,one=(tx*px+ty*py+tz*pz)/size;if(one<0||one>1)return 1/0;let qx=ty*uz-tz*uy,qy=tz*ux-tx*uz,
qz=tx*uy-ty*ux,two=(dx*qx+dy*qy+dz*qz)/size;return two<0||one+two>1?1/0:(vx*qx+vy*qy+vz*qz)/size}function pickBuilding(viewer,x,y){let{camera,canvas,layers,look,
scene}=viewer,{triangles,points,prints}=scene,{seen,from,along}=sightOf(camera,canvas.clientWidth,canvas.clientHeight,x,y),onSide=viewer.epochs.seenAt(x),best=0,
nearest=1/0,offer=({building:buildings,epochs},number,depth)=>{let building=buildings[number];building&&onSide(epochs[number])&&depth<nearest&&!(look.only&&look.
chosen&&building!==look.chosen)&&([best,nearest]=[building,depth])},shownTriangles=layers.models.shown,shownPoints=layers.points.shown,shownPrints=layers.prints.
shown;for(let place=0;place<shownTriangles.length;place+=3){let depth=hitTriangle(triangles.xyz,3*shownTriangles[place],from,along);(camera.flat||depth>0)&&offer(
triangles,shownTriangles[place]/3,depth)}for(let point of shownPoints){if(!points.building[point])continue;let{aside,down,depth,ahead}=seen(points.xyz[3*point],
points.xyz[3*point+1],points.xyz[3*point+2]);ahead&&Math.hypot(aside,down)<NEAR_ENOUGH&&offer(points,point,depth)}for(let place=0;place<shownPrints.length;place+=
2){let[one,two]=[0,1].map(end=>3*shownPrints[place+end]).map(at=>seen(prints.xyz[at],prints.xyz[at+1],prints.xyz[at+2]));if(!one.ahead||!two.ahead)continue;let[
x1,y1,x2,y2]=[one.aside,one.down,two.aside-one.aside,two.down-one.down],share=Math.max(0,Math.min(1,-(x1*x2+y1*y2)/(x2*x2+y2*y2||1)));Math.hypot(x1+share*x2,y1+
share*y2)<NEAR_ENOUGH&&offer(prints,shownPrints[place]/2,one.depth)}return best}var ARROWS={ArrowLeft:[1,0],ArrowRight:[-1,0],ArrowUp:[0,1],ArrowDown:[0,-1]};function listenToCanvas(viewer){let{canvas,camera}=viewer,down=new Map,moved=0,taken=0,
tap=(x,y)=>{viewer.ruler.active?viewer.ruler.take(x,y):viewer.choose(pickBuilding(viewer,x,y)-1,!1)};canvas.addEventListener("pointerdown",event=>{canvas.setPointerCapture(
event.pointerId),moved=0,viewer.tools.pointer("down",event)?taken=event.pointerId:down.set(event.pointerId,[event.clientX,event.clientY])}),canvas.addEventListener(
"pointermove",event=>{if((taken===event.pointerId||!down.size)&&viewer.tools.pointer("move",event),!down.has(event.pointerId))return;let[x,y]=down.get(event.pointerId)??
[0,0],[right,lower]=[event.clientX-x,event.clientY-y];if(moved+=Math.hypot(right,lower),down.size===2){let[other]=[...down].filter(([id])=>id!==event.pointerId).
map(([,place])=>place);camera.zoom(Math.hypot(x-other[0],y-other[1])/Math.max(1,Math.hypot(event.clientX-other[0],event.clientY-other[1]))),camera.pan(right/2,lower/
2,canvas.clientHeight)}else event.buttons&6||event.shiftKey||event.ctrlKey?camera.pan(right,lower,canvas.clientHeight):camera.turn(-right*.006,lower*.006);down.
set(event.pointerId,[event.clientX,event.clientY]),viewer.ask()});let lift=event=>{let box=canvas.getBoundingClientRect();taken===event.pointerId&&(taken=0,viewer.
tools.pointer("up",event)),down.delete(event.pointerId)&&moved<4&&event.type==="pointerup"&&event.button===0&&(viewer.tools.pointer("tap",event)||tap(event.clientX-
box.left,event.clientY-box.top),viewer.ask())};canvas.addEventListener("pointerup",lift),canvas.addEventListener("pointercancel",lift),canvas.addEventListener("\
dblclick",()=>!viewer.ruler.active&&viewer.look.chosen&&viewer.choose(viewer.look.chosen-1)),canvas.addEventListener("contextmenu",event=>event.preventDefault()),
canvas.addEventListener("wheel",event=>{event.preventDefault(),camera.zoom(Math.exp(Math.max(-.4,Math.min(.4,event.deltaY*(event.deltaMode?.04:.0015))))),viewer.
ask()},{passive:!1}),canvas.addEventListener("keydown",event=>{let arrows=ARROWS[event.key],count=viewer.scene.rows.length;if(viewer.tools.active?.keydown?.(event))
return event.preventDefault();if(!(event.ctrlKey||event.metaKey||event.altKey)){if(arrows&&event.shiftKey)camera.pan(40*arrows[0],40*arrows[1],canvas.clientHeight);else if(arrows)
camera.turn(-.1*arrows[0],.1*arrows[1]);else if("+=".includes(event.key))camera.zoom(.85);else if("-_".includes(event.key))camera.zoom(1/.85);else if(event.key===
"Escape"&&viewer.tools.active)viewer.tools.stop();else if(event.key==="Escape"&&viewer.ruler.active)viewer.ruler.toggle(!1);else if(event.key==="Escape")viewer.
choose(-1);else if("nNpP".includes(event.key)&&count)viewer.choose((viewer.look.chosen-1+("nN".includes(event.key)?1:-1)+count+(viewer.look.chosen||"nN".includes(
event.key)?0:1))%count);else if(event.key==="Enter")tap(canvas.clientWidth/2,canvas.clientHeight/2);else if(event.key==="/")byId("find").focus();else if(!pressed(
event.key))return;event.preventDefault(),viewer.ask()}})}function pressed(key){let button=[...document.querySelectorAll("button[aria-keyshortcuts]")].find(one=>one.
getAttribute("aria-keyshortcuts")===key);return button?.click(),!!button}function listenToControls(viewer){for(let control of document.querySelectorAll("#contro\
ls input:not([type=text]), #controls select"))control.addEventListener("input",()=>viewer.refresh());for(let button of document.querySelectorAll("[data-view]"))
button.addEventListener("click",()=>viewer.view(button.dataset.view??""));let find=field("find");find.addEventListener("change",()=>{byId("answer").textContent=
"";let wanted=find.value.trim(),{all}=viewer,place=wanted.match(/^(-?\d+(?:\.\d+)?)[,; ]+(-?\d+(?:\.\d+)?)$/);if(viewer.network.offer(""),place)return viewer.fly(
place.slice(1).map((value,axis)=>Number(value)*page.unit-viewer.origin[axis]));let number=all.findIndex(row=>row.id===wanted);number<0&&wanted&&(number=all.findIndex(
row=>String(row.id).includes(wanted))),number>=0?viewer.choose(number):wanted&&(byId("answer").textContent=`no building here has an id with ${wanted} in it`),viewer.
network.offer(number<0?wanted:"")}),byId("theme").addEventListener("click",()=>{let root=document.documentElement,dark=getComputedStyle(root).colorScheme==="dar\
k"||getComputedStyle(root).colorScheme!=="light"&&matchMedia("(prefers-color-scheme: dark)").matches;root.dataset.theme=dark?"light":"dark",viewer.refresh()})}var WIDE=186,TALL=232,SCALE=500,FINE=8;function listenToPrint(viewer){addEventListener("beforeprint",()=>byId("sheet").replaceChildren(...drawSheet(viewer))),addEventListener(
"afterprint",()=>byId("sheet").replaceChildren()),byId("print").addEventListener("click",()=>print())}function drawSheet(viewer){let{camera,painter,look}=viewer,
spot=viewer.spots[look.chosen-1],root=document.documentElement,{theme}=root.dataset,kept={azimuth:camera.azimuth,elevation:camera.elevation,distance:camera.distance,
flat:camera.flat,target:camera.target};spot&&Number.isFinite(spot.low[0])&&(camera.target=spot.low.map((value,axis)=>(value+spot.high[axis])/2));let middle=camera.
target;camera.above(!1),camera.distance=TALL*SCALE/1e3/(2*Math.tan(.7/2)),root.dataset.theme="light",viewer.refresh();let size=[WIDE*FINE,TALL*FINE],[before]=viewer.
before();painter.begin(before,{...look,background:[1,1,1],split:0},QUALITIES[0],size);for(let piece of painter.pieces(QUALITIES[0]))painter.draw(piece);painter.
present();let picture=element("canvas",{width:size[0],height:size[1],role:"img","aria-label":"The buildings from above"});picture.getContext("2d")?.drawImage(viewer.
canvas,0,0),Object.assign(camera,kept),theme?root.dataset.theme=theme:delete root.dataset.theme;let legend2=byId("model-legend").cloneNode(!0);legend2.removeAttribute(
"id"),viewer.refresh();let row=viewer.all[look.chosen-1],shown=["trust","review_reason","area_m2","measuredHeight","lod","roof_type"].filter(name=>row?.[name]!==
null&&row?.[name]!==void 0),[east,north]=middle.map((value,axis)=>((value+viewer.origin[axis])/(axis<2?page.unit:1)).toFixed(1));return[element("h1",{},row?`Bui\
lding ${row.id}`:document.title),element("div",{class:"plan",style:`width:${WIDE}mm;height:${TALL}mm`},picture,...labels(viewer,middle),element("span",{class:"n\
orth"},"▲",element("br"),"N")),element("div",{class:"foot"},element("div",{},element("span",{class:"bar",style:`width:${2e4/SCALE}mm`},"20 m"),` 1 : ${SCALE} \
on A4 at 100 %; middle ${east}, ${north}`),element("div",{},shown.map(name=>`${page.meanings[name]?.[0]??name}: ${figure(row[name],name)}`).join("; ")),legend2,
element("div",{},byId("credit").textContent??""))]}function labels(viewer,middle){let inside=viewer.spots.map(({low,high},number)=>({id:viewer.all[number].id,wide:(high[0]-
low[0])*1e3/SCALE,x:((low[0]+high[0])/2-middle[0])*1e3/SCALE+WIDE/2,y:(middle[1]-(low[1]+high[1])/2)*1e3/SCALE+TALL/2})).filter(({id,wide,x,y})=>wide>1.4*String(
id).length&&x>8&&x<WIDE-8&&y>4&&y<TALL-4);return inside.filter(({id,x,y},place)=>!inside.slice(0,place).some(other=>Math.abs(other.x-x)<.7*(String(other.id).length+
String(id).length)&&Math.abs(other.y-y)<3)).map(({id,x,y})=>element("span",{class:"id",style:`left:${x.toFixed(2)}mm;top:${y.toFixed(2)}mm`},id))}var SNAP=9,SVG="http://www.w3.org/2000/svg";function pickPlace(viewer,x,y){let{camera,canvas,layers,scene}=viewer,sight=sightOf(camera,canvas.clientWidth,canvas.
clientHeight,x,y),onSide=viewer.epochs.seenAt(x),depth=1/0,meet=(xyz,list,epochOf)=>{let corners=new Float64Array(9);for(let place=0;place<list.length;place+=3){
if(!onSide(epochOf(list[place])))continue;for(let k=0;k<9;k++)corners[k]=xyz[3*list[place+Math.floor(k/3)]+k%3];let far=hitTriangle(corners,0,sight.from,sight.along);
(camera.flat||far>0)&&far<depth&&(depth=far)}};meet(scene.triangles.xyz,layers.models.shown,vertex=>scene.triangles.epochs[vertex/3]),scene.grounds.forEach(({position,
epoch},place)=>meet(position,layers.grounds[place].shown,()=>epoch));let best=Number.isFinite(depth)?sight.from.map((value,axis)=>value+depth*sight.along[axis]):
null,nearest=SNAP,limit=best?sight.seen(best[0],best[1],best[2]).depth+1:1/0,offer=place=>{let{aside,down,depth:far,ahead}=sight.seen(place[0],place[1],place[2]),
away=Math.hypot(aside,down);ahead&&far<=limit&&away<nearest&&([best,nearest]=[place,away])};for(let vertex of layers.edges.shown)onSide(scene.edges.epochs[vertex>>
1])&&offer([...scene.edges.xyz.subarray(3*vertex,3*vertex+3)]);if(nearest===SNAP)for(let layer of[layers.points,layers.other])for(let point of layer.shown)onSide(
scene.points.epochs[point])&&offer([...scene.points.xyz.subarray(3*point,3*point+3)]);return best}var Ruler=class _Ruler{constructor(viewer){this.viewer=viewer,
this.places=[],this.active=!1,this.sheet=document.createElementNS(SVG,"svg"),this.sheet.id="ruler",viewer.canvas.after(this.sheet),byId("measure").addEventListener(
"click",()=>this.toggle())}toggle(on=!this.active){this.active=on,on&&this.viewer.tools.stop(),on||(this.places=[]),byId("measure").setAttribute("aria-pressed",
String(on)),byId("status").textContent=on?"measuring: click on places; Escape ends it":"measuring ended",this.viewer.canvas.style.cursor=on?"crosshair":"",on||this.
viewer.profile.toggle(!1),this.draw()}take(x,y){let place=pickPlace(this.viewer,x,y);place&&this.places.push(place),this.draw(),this.viewer.profile.draw()}static between(one,two){
let[east,north,up]=two.map((value,axis)=>value-one[axis]);return{level:Math.hypot(east,north),up,straight:Math.hypot(east,north,up)}}draw(){let{camera,canvas}=this.
viewer,{seen}=sightOf(camera,canvas.clientWidth,canvas.clientHeight,0,0),spots=this.places.map(place=>seen(place[0],place[1],place[2])),made2=[],add=(name,attributes,text="")=>{
let one=document.createElementNS(SVG,name);for(let[key,value]of Object.entries(attributes))one.setAttribute(key,String(value));text&&(one.textContent=text),made2.
push(one)},whole=0;for(let k=1;k<spots.length;k++){let[one,two]=[spots[k-1],spots[k]],{level,up,straight}=_Ruler.between(this.places[k-1],this.places[k]);if(whole+=
straight,!one.ahead||!two.ahead)continue;add("line",{x1:one.aside,y1:one.down,x2:two.aside,y2:two.down});let steep=Math.abs(up)>.05?` (level ${level.toFixed(2)}\
, up ${up.toFixed(2)}, ${(Math.atan2(up,level)*180/Math.PI).toFixed(1)}°)`:"";add("text",{x:(one.aside+two.aside)/2,y:(one.down+two.down)/2-7},`${straight.toFixed(
2)} m${steep}`)}for(let{aside,down,ahead}of spots)ahead&&add("circle",{cx:aside,cy:down,r:4});let last=spots[spots.length-1];spots.length>2&&last.ahead&&add("te\
xt",{x:last.aside+10,y:last.down+18},`${whole.toFixed(2)} m in all`),this.sheet.replaceChildren(...made2);let height=this.places.length?this.places[this.places.
length-1][2]+page.base:null;this.active&&height!==null&&(byId("status").textContent=`${whole.toFixed(2)} metres; last place at height ${height.toFixed(2)}`)}};var SVG2="http://www.w3.org/2000/svg",Tools=class{constructor(viewer){this.viewer=viewer,this.all=new Map,this.active=null,this.drawings=new Map,this.choosers=[],
this.sheet=document.createElementNS(SVG2,"svg"),this.sheet.id="overlay",viewer.canvas.after(this.sheet)}get origin(){return this.viewer.origin}get rows(){return this.
viewer.all}get chosen(){return this.viewer.look.chosen-1}add(tool){let keys=tool.key.split(" ").map(key=>element("kbd",{},key)),button=element("button",{type:"b\
utton",id:`tool-${tool.id}`,title:tool.does,"aria-keyshortcuts":tool.key},tool.name," ",...keys);return button.addEventListener("click",()=>this.press(tool)),tool.
start&&button.setAttribute("aria-pressed","false"),byId("views").append(button),this.all.set(tool.id,tool),button}press(tool){if(tool.press)return tool.press();
let on=this.active!==tool;this.stop(),on&&(this.viewer.ruler.toggle(!1),this.active=tool,byId(`tool-${tool.id}`).setAttribute("aria-pressed","true"),tool.start?.())}stop(){
let tool=this.active;tool&&(this.active=null,byId(`tool-${tool.id}`).setAttribute("aria-pressed","false"),tool.stop?.())}remove(id){this.active?.id===id&&this.stop(),
this.all.delete(id),document.getElementById(`tool-${id}`)?.remove()}at(x,y){let{viewer}=this;return{x,y,building:()=>pickBuilding(viewer,x,y)-1,place:()=>pickPlace(
viewer,x,y),level:z=>{let{from,along}=sightOf(viewer.camera,viewer.canvas.clientWidth,viewer.canvas.clientHeight,x,y),far=(z-from[2])/along[2];return[from[0]+far*
along[0],from[1]+far*along[1],z]}}}seen([x,y,z]){let{camera,canvas}=this.viewer,{aside,down,ahead}=sightOf(camera,canvas.clientWidth,canvas.clientHeight,0,0).seen(
x,y,z);return{x:aside,y:down,ahead}}pointer(kind,event){if(!this.active?.pointer)return!1;let box=this.viewer.canvas.getBoundingClientRect();return this.active.
pointer(kind,this.at(event.clientX-box.left,event.clientY-box.top),event)===!0}overlay(name,drawing){drawing?this.drawings.set(name,drawing):this.drawings.delete(
name),this.draw()}draw(){let sheet=[...this.drawings].map(([name,{lines=[],points=[],words:words2=[]}])=>{let group=made("g",{class:name});for(let line of lines){
let ends=line.map(place=>this.seen(place));ends.every(end=>end.ahead)&&group.append(made("polyline",{points:ends.map(({x,y})=>`${x},${y}`).join(" ")}))}for(let place of points){
let{x,y,ahead}=this.seen(place);ahead&&group.append(made("circle",{cx:x,cy:y,r:5}))}for(let[place,text]of words2){let{x,y,ahead}=this.seen(place);ahead&&group.append(
made("text",{x,y:y-9},text))}return group});this.sheet.replaceChildren(...sheet)}fly(place,radius=15){this.viewer.camera.flyTo(place,radius),this.viewer.ask()}choose(number,fly=!0){
this.viewer.choose(number,fly)}onChoose(done){this.choosers.push(done)}say(text){byId("note").textContent=text,byId("note").hidden=!text}panel(id,title){let box=element(
"fieldset",{id},element("legend",{},title));return byId("controls").prepend(box),box}async replace(number,packed,row){let{viewer}=this,{scene,table}=viewer,fresh=packed?
readShapes(await unpackAll(packed)):null;if(viewer.city)throw new Error("a page that is loaded by squares changes no geometry");if(number<0&&(number=scene.rows.
length,scene.rows.push({id:""}),viewer.all.splice(number,0,{id:""}),table?.add(number)),number>=scene.rows.length)throw new Error("this building is not drawn");
return row&&(scene.rows[number]=viewer.all[number]=row),viewer.exchange(number,fresh),packed?table&&!table.order.includes(number)&&table.order.push(number):table?.
remove(number),viewer.look.chosen===number+1&&packed?viewer.tell(number,!1):viewer.look.chosen===number+1&&viewer.choose(-1,!1),table?.update(),number}};function made(name,attributes,text){
let one=document.createElementNS(SVG2,name);for(let[key,value]of Object.entries(attributes))one.setAttribute(key,String(value));return text&&(one.textContent=text),
one}function beginExtensions(tools){let begin=extension=>extension(tools),waiting=globalThis.window.eavesExtensions??[];window.eavesExtensions={push:begin};for(let extension of waiting)
begin(extension)}var VERTEX=`#version 300 es
precision highp float;
in vec3 position; in vec4 colour; in float building;
uniform mat4 view; uniform float chosen, only, points, strength, fade; uniform vec3 mark, eye;
out vec3 place; out vec4 tint; out float epoch;
void main() {
  place = position;
  vec3 nearer = points != 0.0 ? place + 0.15 * normalize(eye - place) : place;
  gl_Position = view * vec4(nearer, 1.0);
  gl_PointSize = points > 0.0 ? clamp(points / gl_Position.w, 1.5, 11.0) : -points;
  bool mine = chosen > 0.0 && abs(building - chosen) < 0.5;
  if (only > 0.5 && !mine && building > 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  epoch = 255.0 * colour.a;
  tint = mine ? vec4(mix(colour.rgb, mark, strength), 1.0) : vec4(colour.rgb, fade);
}`,FRAGMENT=`#version 300 es
precision highp float;
in vec3 place; in vec4 tint; in float epoch;
uniform float shaded, points, pictured, split; uniform vec3 eye, lay[4]; uniform sampler2D image;
out vec4 result;
void main() {
  if (epoch > 0.5 && (gl_FragCoord.x < split) != (epoch < 1.5)) discard;
  float light = 1.0;
  if (shaded > 0.5) {
    vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
    if (dot(normal, eye - place) < 0.0) normal = -normal;
    light = 0.62 + 0.3 * max(0.0, dot(normal, normalize(vec3(-0.6, 0.5, 0.65)))) + 0.14 * max(0.0, normal.z);
  } else if (points != 0.0 && distance(gl_PointCoord, vec2(0.5)) > 0.5) discard;
  vec3 own = tint.rgb;
  if (pictured > 0.5) {
    vec3 first = vec3(1.0, place.xy), second = vec3(place.x * place.xy, place.y * place.y);
    own *= texture(image, vec2(dot(lay[0], first) + dot(lay[1], second), dot(lay[2], first) + dot(lay[3], second))).rgb;
    light = mix(light, 1.0, 0.6);
  }
  result = vec4(own * light, tint.a);
}`,UNIFORMS=["view","chosen","only","points","strength","fade","mark","shaded","eye","pictured","lay","split"];var Painter=class{constructor(canvas){let gl=canvas.getContext("webgl2",{antialias:!1,alpha:!1,depth:!1});if(!gl)throw new Error("this browser gives no WebGL2; \
the table and the figures below work without it");this.gl=gl,this.canvas=canvas,this.layers=[],this.targets=new Map,this.spot=this.fade=this.far=1,this.texture=
null,this.lay=null,this.target=null,this.sight={matrix:new Float32Array(16),eye:[0,0,0],step:1,distance:1,flat:!1};let program=this.program=gl.createProgram();for(let[
kind,source2]of[[gl.VERTEX_SHADER,VERTEX],[gl.FRAGMENT_SHADER,FRAGMENT]]){let shader=gl.createShader(kind);if(gl.shaderSource(shader,source2),gl.compileShader(shader),
!gl.getShaderParameter(shader,gl.COMPILE_STATUS))throw new Error(gl.getShaderInfoLog(shader)??"");gl.attachShader(program,shader)}if(["position","colour","build\
ing"].forEach((name,place)=>gl.bindAttribLocation(program,place,name)),gl.linkProgram(program),!gl.getProgramParameter(program,gl.LINK_STATUS))throw new Error(gl.
getProgramInfoLog(program)??"");this.uniform=Object.fromEntries(UNIFORMS.map(name=>[name,gl.getUniformLocation(program,name)])),this.samples=Math.min(4,gl.getParameter(
gl.MAX_SAMPLES))}add(kind,position,building,{shaded=!1,strength=0,minor=!1,fades=!1,opacity=1}={}){let gl=this.gl,vao=gl.createVertexArray();gl.bindVertexArray(
vao);let buffers=[],fill=(place,data,size,type,normalised)=>{let buffer=gl.createBuffer();return buffers.push(buffer),gl.bindBuffer(gl.ARRAY_BUFFER,buffer),gl.bufferData(
gl.ARRAY_BUFFER,data,gl.DYNAMIC_DRAW),gl.enableVertexAttribArray(place),gl.vertexAttribPointer(place,size,type,normalised,0,0),buffer};fill(0,position,3,gl.FLOAT,
!1);let colour=fill(1,new Uint8Array(4*position.length/3),4,gl.UNSIGNED_BYTE,!0);fill(2,building,1,gl.UNSIGNED_INT,!1),gl.bindVertexArray(null);let mode={points:gl.
POINTS,triangles:gl.TRIANGLES,lines:gl.LINES}[kind],layer={kind,mode,vao,buffers,colour,shaded,strength,minor,fades,opacity,pictured:!1,drawn:[],shown:new Uint32Array(
0)};return this.layers.push(layer),layer}refill({buffers},position,building){let gl=this.gl;for(let[buffer,data]of[[buffers[0],position],[buffers[2],building]])
gl.bindBuffer(gl.ARRAY_BUFFER,buffer),gl.bufferData(gl.ARRAY_BUFFER,data,gl.DYNAMIC_DRAW)}clear(){for(let{vao,buffers,drawn}of this.layers){this.gl.deleteVertexArray(
vao);for(let buffer of[...buffers,...drawn.map(list=>list.buffer)])this.gl.deleteBuffer(buffer)}this.layers=[]}picture(image,lay2){let gl=this.gl;gl.deleteTexture(
this.texture),gl.bindTexture(gl.TEXTURE_2D,this.texture=gl.createTexture()),gl.texImage2D(gl.TEXTURE_2D,0,gl.RGB8,gl.RGB,gl.UNSIGNED_BYTE,image),gl.generateMipmap(
gl.TEXTURE_2D);for(let side of[gl.TEXTURE_WRAP_S,gl.TEXTURE_WRAP_T])gl.texParameteri(gl.TEXTURE_2D,side,gl.CLAMP_TO_EDGE);gl.texParameteri(gl.TEXTURE_2D,gl.TEXTURE_MIN_FILTER,
gl.LINEAR_MIPMAP_LINEAR);let slanted=gl.getExtension("EXT_texture_filter_anisotropic");slanted&&gl.texParameteri(gl.TEXTURE_2D,slanted.TEXTURE_MAX_ANISOTROPY_EXT,
8),this.lay=new Float32Array(lay2)}recolour(layer,colours){this.gl.bindBuffer(this.gl.ARRAY_BUFFER,layer.colour),this.gl.bufferData(this.gl.ARRAY_BUFFER,colours,
this.gl.DYNAMIC_DRAW)}show(layer,...lists){let gl=this.gl;for(let{buffer}of layer.drawn)gl.deleteBuffer(buffer);gl.bindVertexArray(null),layer.drawn=lists.map(list=>{
let buffer=gl.createBuffer();return gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER,buffer),gl.bufferData(gl.ELEMENT_ARRAY_BUFFER,list,gl.STATIC_DRAW),{buffer,count:list.
length,numbers:list}}),layer.shown=lists[0]}pieces({points,ground,lines,detail}){let pieces=[];for(let layer of this.layers){if(layer.blocks&&pieces.push(...this.
piecesOf(layer.blocks,detail)),layer.blocks)continue;let list=layer.drawn[Math.min(ground,layer.drawn.length-1)];if(!list||layer.minor&&!lines)continue;let count=layer.
kind==="points"?Math.min(points,list.count):list.count,grown=layer.kind==="points"?Math.min(2.2,Math.sqrt(list.count/Math.max(1,count))):1;for(let first=0;first<
count;first+=9e4)pieces.push({layer,list,first,count:Math.min(9e4,count-first),grown})}return pieces}piecesOf(blocks,detail){let pieces=[];for(let{low,high,ways}of blocks){
let step=low.length?detail*this.stepAt(low,high):0;if(Number.isNaN(step))continue;let{layer,list,first,count}=ways.find(way=>way.size>=step)??ways[ways.length-1],
last=pieces[pieces.length-1];if(last&&last.list===list&&last.first+last.count===first&&last.count+count<=9e4)last.count+=count;else for(let from=first;from<first+
count;from+=9e4)pieces.push({layer,list,first:from,count:Math.min(9e4,first+count-from),grown:1})}return pieces}stepAt(low,high){let{matrix,eye,step,distance,flat}=this.
sight,outside=[0,0,0,0];for(let corner=0;corner<8;corner++){let place=[...low.map((value,axis)=>corner>>axis&1?high[axis]:value),1],[x,y,,w]=[0,1,2,3].map(row=>place.
reduce((sum,value,column2)=>sum+value*matrix[4*column2+row],0));[x<-w,x>w,y<-w,y>w].forEach((beyond,side)=>{outside[side]+=beyond?1:0})}return outside.includes(
8)?NaN:flat?step:step*Math.hypot(...eye.map((value,axis)=>Math.max(low[axis]-value,0,value-high[axis])))/distance}begin(camera,look,{scale,smooth},size){let gl=this.
gl,uniform=this.uniform,ratio=scale*Math.min(2,window.devicePixelRatio||1),[width,height]=size??[this.canvas.clientWidth,this.canvas.clientHeight].map(side=>Math.
max(1,Math.round(side*ratio)));this.target=this.targetOf(width,height,smooth?this.samples:0),gl.bindFramebuffer(gl.FRAMEBUFFER,this.target.frame),gl.viewport(0,
0,width,height),gl.depthMask(!0);let[red,green,blue]=look.background;gl.clearColor(red,green,blue,1),gl.clear(gl.COLOR_BUFFER_BIT|gl.DEPTH_BUFFER_BIT),gl.enable(
gl.DEPTH_TEST),gl.depthFunc(gl.LEQUAL),gl.useProgram(this.program);let matrix=camera.matrix(width/height),eye=camera.eye();this.sight={matrix,eye,step:camera.step(
height),distance:camera.distance,flat:camera.flat},gl.uniformMatrix4fv(uniform.view,!1,matrix),gl.uniform3fv(uniform.eye,eye),gl.uniform1f(uniform.chosen,look.chosen),
gl.uniform1f(uniform.only,look.only?1:0),gl.uniform1f(uniform.split,look.split*width),gl.uniform3fv(uniform.mark,look.mark),this.spot=look.pointSize/camera.step(
height),this.fade=Math.min(1,Math.max(.2,.16/camera.step(this.canvas.clientHeight))),this.far=camera.flat?0:camera.distance}draw({layer,list,first,count,grown}){
let gl=this.gl,uniform=this.uniform,spot=this.spot*grown,points=layer.kind!=="points"?0:this.far?spot*this.far:-Math.min(11,Math.max(1.5,spot));gl.uniform1f(uniform.
points,points),gl.uniform1f(uniform.shaded,layer.shaded?1:0),gl.uniform1f(uniform.strength,layer.strength),gl.uniform1f(uniform.fade,layer.fades?this.fade:layer.
opacity),gl.uniform1f(uniform.pictured,layer.pictured?1:0),layer.pictured&&this.lay&&gl.uniform3fv(uniform.lay,this.lay),gl.depthMask(layer.opacity===1),layer.fades||
layer.opacity<1?(gl.enable(gl.BLEND),gl.blendFunc(gl.SRC_ALPHA,gl.ONE_MINUS_SRC_ALPHA)):gl.disable(gl.BLEND),layer.kind==="triangles"?(gl.enable(gl.POLYGON_OFFSET_FILL),
gl.polygonOffset(1.5,2)):gl.disable(gl.POLYGON_OFFSET_FILL),gl.bindVertexArray(layer.vao),gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER,list.buffer),gl.drawElements(layer.
mode,count,gl.UNSIGNED_INT,4*first),gl.bindVertexArray(null)}present(){let gl=this.gl,{canvas}=this,{frame,width,height}=this.target;(canvas.width!==width||canvas.
height!==height)&&Object.assign(canvas,{width,height}),gl.bindFramebuffer(gl.READ_FRAMEBUFFER,frame),gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER,null),gl.blitFramebuffer(
0,0,width,height,0,0,width,height,gl.COLOR_BUFFER_BIT,gl.NEAREST),gl.bindFramebuffer(gl.FRAMEBUFFER,null)}async finished(){let gl=this.gl,sync=gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE,
0);for(gl.flush();sync&&gl.clientWaitSync(sync,0,0)===gl.TIMEOUT_EXPIRED;)await new Promise(done=>setTimeout(done,1));gl.deleteSync(sync)}targetOf(width,height,samples){
let gl=this.gl,old=this.targets.get(samples);if(old&&old.width===width&&old.height===height)return old;if(old){gl.deleteFramebuffer(old.frame);for(let buffer of old.
buffers)gl.deleteRenderbuffer(buffer)}let frame=gl.createFramebuffer(),buffers=[];gl.bindFramebuffer(gl.FRAMEBUFFER,frame);for(let[place,format]of[[gl.COLOR_ATTACHMENT0,
gl.RGB8],[gl.DEPTH_ATTACHMENT,gl.DEPTH_COMPONENT24]]){let buffer=gl.createRenderbuffer();gl.bindRenderbuffer(gl.RENDERBUFFER,buffer),gl.renderbufferStorageMultisample(
gl.RENDERBUFFER,samples,format,width,height),gl.framebufferRenderbuffer(gl.FRAMEBUFFER,place,gl.RENDERBUFFER,buffer),buffers.push(buffer)}let target={frame,buffers,
width,height};return this.targets.set(samples,target),target}};var TILE=256,MOST_TILES=144,WIDEST=16,FINEST_ZOOM=19,OSM_CREDIT="© OpenStreetMap contributors",lay=()=>page.world,Network=class _Network{constructor(viewer){this.
viewer=viewer,this.asked=0,byId("network").hidden=!page.world,frameOf("tiles").hidden=!page.terrain.rows;for(let name of["tiles","own-tiles","own-credit"])byId(
name).addEventListener("change",()=>this.chooseMap());byId("ask").addEventListener("click",()=>this.findAddress(field("find").value.trim()))}offer(wanted){byId(
"ask").hidden=!page.world||!wanted,byId("ask").textContent=`Ask ${field("geocoder").value.replace(/^https?:..([^/]+).*/,"$1")}`}static toWorld([x,y]){return lay().
map(([a,b,c,d,e,f])=>a+b*x+c*y+d*x*x+e*x*y+f*y*y)}static fromWorld([u,v]){let[[,a,b],[,c,d]]=lay(),place=[0,0];for(let round=0;round<8;round++){let[one,two]=_Network.
toWorld(place),[du,dv]=[u-one,v-two];place=[place[0]+(d*du-b*dv)/(a*d-b*c),place[1]+(a*dv-c*du)/(a*d-b*c)]}return place}extent(){let{low,high}=boxOf(this.viewer.
scene),corners=[low[0],high[0]].flatMap(x=>[low[1],high[1]].map(y=>_Network.toWorld([x,y]))),[u,v]=[0,1].map(axis=>corners.map(corner=>corner[axis]));return[Math.
min(...u),Math.min(...v),Math.max(...u),Math.max(...v)]}async chooseMap(){let own=field("tiles").value==="own",address=own?field("own-tiles").value.trim():field(
"tiles").value,ticket=++this.asked;for(let name of["own-tiles","own-credit"])frameOf(name).hidden=!own;if(this.viewer.painter.lay=null,frameOf("basemap").hidden=
!page.basemap,byId("credit").textContent="",byId("requests").textContent="Nothing is requested.",page.basemap&&await this.viewer.addImage(page.basemap),this.viewer.
refresh(),!!address)try{await this.drawMap(address,own?field("own-credit").value.trim():OSM_CREDIT,ticket)}catch(error){byId("requests").textContent=`No map: ${messageOf(
error)}.`}}async drawMap(address,credit,ticket){let[west,north,east,south]=this.extent(),range=zoom2=>[west,north,east,south].map(side=>Math.floor(side*2**zoom2)),
zoom=FINEST_ZOOM,wide=0,tall=0,left=0,top=0;for(;zoom>=0;zoom--){let[a,b,c,d]=range(zoom);if([left,top,wide,tall]=[a,b,c-a+1,d-b+1],wide*tall<=MOST_TILES&&Math.
max(wide,tall)<=WIDEST)break}let fill=(x,y)=>{let words2={s:"a",z:zoom,tilematrix:zoom,x,tilecol:x,y,tilerow:y,"-y":2**zoom-1-y};return address.replace(/\{([\w-]+)\}/g,
(whole,name)=>String(words2[name.toLowerCase()]??whole))};if(fill(0,0)===fill(0,1)||fill(0,0)===fill(1,0))throw new Error("the address lacks one of {z}, {x} and\
 {y}");let{host}=new URL(fill(left,top)),sheet=element("canvas",{width:wide*TILE,height:tall*TILE}),pen=sheet.getContext("2d");pen.fillStyle="#ffffff",pen.fillRect(
0,0,sheet.width,sheet.height),byId("requests").textContent=`Asks ${host} for ${wide*tall} tiles …`;let missing=[],load=async(x,y)=>{try{let answer=await fetch(
fill(left+x,top+y),{credentials:"omit"});if(!answer.ok)throw new Error(`status ${answer.status}`);pen.drawImage(await createImageBitmap(await answer.blob()),x*TILE,
y*TILE,TILE,TILE)}catch(error){missing.push(messageOf(error))}};if(await Promise.all(Array.from({length:wide*tall},(_,place)=>load(place%wide,Math.floor(place/wide)))),
ticket!==this.asked)return;let hint=location.protocol==="file:"?"; some servers answer no page opened from disk, only one of a web server (eaves view OUT --serv\
e)":"";if(missing.length===wide*tall)throw new Error(`${host} gave no tile: ${missing[0]}${hint}`);let grown=2**zoom;this.viewer.painter.picture(sheet,lay().flatMap(
(terms,axis)=>terms.map((value,term)=>(value*grown-(term?0:[left,top][axis]))/[wide,tall][axis]))),byId("requests").textContent=`${wide*tall-missing.length} of ${wide*
tall} tiles came from ${host} (zoom ${zoom}).`,byId("credit").textContent=`map: ${credit||host}`,frameOf("basemap").hidden=!1,this.viewer.refresh()}async findAddress(wanted){
let say=text=>{byId("answer").textContent=text};this.offer("");try{let address=new URL(field("geocoder").value),[west,north,east,south]=this.extent(),degrees=v=>Math.
atan(Math.sinh(Math.PI*(1-2*v)))*180/Math.PI,box=[360*west-180,degrees(north),360*east-180,degrees(south)];for(let[name,value]of Object.entries({q:wanted,format:"\
jsonv2",limit:"1",bounded:"1",viewbox:box.map(side=>side.toFixed(6)).join()}))address.searchParams.set(name,value);say(`Asks ${address.host} …`);let answer=await fetch(
address,{credentials:"omit"});if(!answer.ok)throw new Error(`${address.host} answers with status ${answer.status}`);let[found]=await answer.json();if(!found)return say(
`${address.host} knows no such address in what is shown.`);let sine=Math.sin(found.lat*Math.PI/180);this.viewer.fly(_Network.fromWorld([(Number(found.lon)+180)/
360,.5-Math.atanh(sine)/(2*Math.PI)])),say(`${found.display_name} (${found.licence||address.host})`)}catch(error){say(`No answer of ${field("geocoder").value}: ${messageOf(
error)}.`)}}};var BESIDE=.5,FRAME={left:46,right:12,top:18,bottom:24};function cutUpright(xyz,list,one,two,name){let long=Math.hypot(two[0]-one[0],two[1]-one[1]),[east,north]=[
(two[0]-one[0])/long,(two[1]-one[1])/long],pieces=[];for(let place=0;place<list.length;place+=3){let ends=[],corners=[0,1,2].map(k=>{let at2=3*list[place+k],[x,
y]=[xyz[at2]-one[0],xyz[at2+1]-one[1]];return[x*east+y*north,xyz[at2+2],y*east-x*north]});for(let k=0;k<3;k++){let[a,b]=[corners[k],corners[(k+1)%3]];if(a[2]<0==
b[2]<0)continue;let share=a[2]/(a[2]-b[2]);ends.push([a[0]+share*(b[0]-a[0]),a[1]+share*(b[1]-a[1])])}if(ends.length<2)continue;let[[s1,z1],[s2,z2]]=ends[0][0]<=
ends[1][0]?ends:ends.reverse(),from=Math.max(0,s1),to=Math.min(long,s2);if(from>to)continue;let at=s=>s2>s1?z1+(z2-z1)*(s-s1)/(s2-s1):null;pieces.push([from,at(
from)??z1,to,at(to)??z2,name(place)])}return pieces}var Profile=class{constructor(viewer){this.viewer=viewer,this.on=!1,this.pieces=[],this.dots=[],this.whole=0,
this.seen=FRAME.left,this.box=byId("profile"),this.sheet=document.createElementNS(SVG,"svg"),this.scale=null,byId("profiling").addEventListener("click",()=>this.
toggle()),this.box.addEventListener("pointermove",event=>this.point(event.clientX-this.box.getBoundingClientRect().left)),this.box.addEventListener("keydown",event=>{
let step={ArrowLeft:-8,ArrowRight:8}[event.key];step&&this.point(this.seen+step),step&&event.preventDefault()}),new ResizeObserver(()=>this.draw()).observe(this.
box)}toggle(on=!this.on){this.on=on,byId("profiling").setAttribute("aria-pressed",String(on)),on&&!this.viewer.ruler.active&&this.viewer.ruler.toggle(!0),this.draw()}cut(){
let{layers,ruler,scene}=this.viewer,kinds=["underside","wall","roof","underside"];this.pieces=[],this.dots=[],this.whole=0;for(let k=1;k<ruler.places.length;k++){
let[one,two]=[ruler.places[k-1],ruler.places[k]],long=Math.hypot(two[0]-one[0],two[1]-one[1]),start2=this.whole;if(long<.01)continue;let older=epoch=>epoch===1?
" old":"",{epochs,kind,xyz}=scene.triangles,grounds=scene.grounds.flatMap(({position,details,epoch})=>cutUpright(position,details[0],one,two,()=>`earth${older(epoch)}`)),
models=cutUpright(xyz,layers.models.shown,one,two,place=>kinds[kind[layers.models.shown[place]/3]]+older(epochs[layers.models.shown[place]/3]));for(let[s1,z1,s2,
z2,name]of[...grounds,...models])this.pieces.push([s1+start2,z1,s2+start2,z2,name]);let[east,north]=[(two[0]-one[0])/long,(two[1]-one[1])/long],roofs=Uint32Array.
from(scene.points.building.keys()).filter(number=>scene.points.building[number]),others=layers.points.shown.filter(number=>!scene.points.building[number]);for(let numbers of[
roofs,others,layers.other.shown])for(let number of numbers){let[x,y]=[scene.points.xyz[3*number]-one[0],scene.points.xyz[3*number+1]-one[1]],s=x*east+y*north;s>=
0&&s<=long&&Math.abs(y*east-x*north)<=BESIDE&&this.dots.push([s+start2,scene.points.xyz[3*number+2],CLASSES[scene.points.classification[number]]?.[1]??NOTHING])}
this.whole+=long}}draw(){if(this.box.hidden=!this.on,!this.on)return;this.cut();let[width,height]=[this.box.clientWidth,this.box.clientHeight],heights=this.pieces.
flatMap(piece=>[piece[1],piece[3]]).concat(this.dots.map(dot=>dot[1])),sheet=this.sheet=document.createElementNS(SVG,"svg");if(!heights.length){this.scale=null,
this.add(sheet,"text",{x:12,y:24},"Click on two places or more: heights along the line between them stand here."),this.box.replaceChildren(sheet);return}let low=heights.
reduce((one,two)=>Math.min(one,two)),high=Math.max(low+1,heights.reduce((one,two)=>Math.max(one,two))),across=(width-FRAME.left-FRAME.right)/this.whole,up=Math.
min((height-FRAME.top-FRAME.bottom)/(high-low),8*across),x=s=>FRAME.left+s*across,y=z=>height-FRAME.bottom-(z-low)*up;this.scale={x,y,s:pixel=>(pixel-FRAME.left)/
across};let stepOf=rough=>[1,2,5,10].map(times2=>times2*10**Math.floor(Math.log10(rough))).find(value=>value>=rough)??rough,wide=stepOf(70/across),tall=stepOf(28/
up),base=page.base;for(let s=0;s<=this.whole+1e-9;s+=wide)this.add(sheet,"line",{class:"axis",x1:x(s),x2:x(s),y1:FRAME.top,y2:height-FRAME.bottom}),this.add(sheet,
"text",{x:x(s),y:height-8,"text-anchor":"middle"},Number(s.toFixed(2)).toString());for(let z=Math.ceil((low+base)/tall)*tall;z<=high+base;z+=tall)this.add(sheet,
"line",{class:"axis",x1:FRAME.left,x2:width-FRAME.right,y1:y(z-base),y2:y(z-base)}),this.add(sheet,"text",{x:FRAME.left-5,y:y(z-base)+4,"text-anchor":"end"},Number(
z.toFixed(2)).toString());for(let[s,z,colour]of this.dots)this.add(sheet,"circle",{cx:x(s),cy:y(z),r:1.6,fill:colour});for(let[s1,z1,s2,z2,name]of this.pieces)this.
add(sheet,"line",{class:name,x1:x(s1),y1:y(z1),x2:x(s2),y2:y(z2)});let times=up/across;this.add(sheet,"text",{x:FRAME.left+2,y:12},`distance and height (m)${Math.
abs(times-1)>.05?`, heights × ${times.toFixed(1)}`:""}; points within ${BESIDE} m`),this.box.replaceChildren(sheet)}add(sheet,name,attributes,text){let one=document.
createElementNS(SVG,name);for(let[key,value]of Object.entries(attributes))one.setAttribute(key,String(value));return text&&(one.textContent=text),sheet.append(one),
one}at(s){let over=earth=>this.pieces.filter(([s1,,s2,,name])=>!name.endsWith("old")&&name==="earth"===earth&&s>=s1&&s<=s2).map(([s1,z1,s2,z2])=>s2>s1?z1+(z2-z1)*
(s-s1)/(s2-s1):Math.max(z1,z2)).reduce((one,two)=>Math.max(one??two,two),null);return{model:over(!1),ground:over(!0)}}point(place){let{scale}=this;if(!scale)return;
this.seen=place;let s=Math.min(this.whole,Math.max(0,scale.s(place))),{model,ground}=this.at(s),top=model??ground;for(let old of this.sheet.querySelectorAll(".c\
ursor"))old.remove();if(top===null)return;let words2=`${s.toFixed(2)} m along, height ${(top+page.base).toFixed(2)}${model!==null&&ground!==null?`, ${(model-ground).
toFixed(2)} over the ground`:""}`;this.add(this.sheet,"line",{class:"cursor",x1:scale.x(s),x2:scale.x(s),y1:FRAME.top,y2:scale.y(top)}),this.add(this.sheet,"tex\
t",{class:"cursor",x:this.box.clientWidth-12,y:12,"text-anchor":"end"},words2)}};var Verdicts=class{constructor(){this.said=new Map,this.row=void 0,byId("verdict").addEventListener("change",()=>this.say(field("verdict").value))}choose(row){this.
row=row,byId("judge").hidden=!row||!!page.epochs,field("verdict").value=row&&this.said.get(row.id)||""}say(verdict){if(!this.row)return;verdict?this.said.set(this.
row.id,verdict):this.said.delete(this.row.id);let link=byId("verdicts"),count=this.said.size;link.href&&URL.revokeObjectURL(link.href),link.hidden=!count,link.href=
URL.createObjectURL(new Blob([this.text()],{type:"text/csv"})),link.textContent=`Save ${count} verdict${count>1?"s":""} (verdicts.csv)`}text(){let quoted=text=>`\
"${String(text).replaceAll('"','""')}"`;return["id,verdict",...[...this.said].map(pair=>pair.map(quoted).join())].join(`\r
`)+`\r
`}};var OTHER_OPACITY=.45;function finestOf({triangles,rows},known){let finest=new Uint8Array(3*(rows.length+1));known&&finest.set(known);for(let number=0;number<triangles.
count;number++){let model=modelOf(triangles,number);finest[model]=Math.max(finest[model],triangles.lod[number])}return finest}var shade=name=>bytes(getComputedStyle(
document.documentElement).getPropertyValue(name).trim()),Viewer=class{constructor(scene,all){this.all=all,this.table=null,this.city=null,this.origin=page.origin,
this.quarter=-1;let canvas=this.canvas=byId("scene");this.camera=new Camera(boxOf(scene),canvas.clientWidth/Math.max(1,canvas.clientHeight)),this.painter=new Painter(
canvas),this.pace=new Pace(this.painter,()=>this.before(),quality=>this.after(quality)),this.look={background:[1,1,1],mark:[1,.6,0],chosen:0,only:!1,pointSize:.35,
split:0},this.spots=spotsOf(scene),this.scene=scene,this.layers=this.layersOf(scene),this.finest=finestOf(scene),this.scale="",this.ruler=new Ruler(this),this.profile=
new Profile(this),this.verdicts=new Verdicts,this.epochs=new Epochs(this),this.network=new Network(this),this.tools=new Tools(this),new ResizeObserver(()=>this.
ask()).observe(canvas),matchMedia("(prefers-color-scheme: dark)").addEventListener("change",()=>this.refresh())}load(scene){this.painter.clear(),this.scene=scene,
this.layers=this.layersOf(scene),this.finest=finestOf(scene)}exchange(number,fresh){let{scene,layers,painter}=this,first={triangles:0,edges:0,prints:0};for(let[
name,layer,width]of[["triangles",layers.models,3],["edges",layers.edges,2],["prints",layers.prints,2]]){let others=without(scene[name],number+1),own=fresh?.[name];
own?.building.fill(number+1),scene[name]=own?joinThings([others,{...own,dressed:new Uint8Array(4*width*own.count),seen:new Uint8Array(own.count)}]):others,first[name]=
others.count,painter.refill(layer,scene[name].xyz,repeated(scene[name].building,width))}let{rows}=scene,none={xyz:new Float32Array(0),building:new Uint32Array(0),
count:0},alone={rows,prints:fresh?.prints??none,triangles:fresh?.triangles??none};this.spots[number]=spotsOf(alone)[number],this.finest.fill(0,3*(number+1),3*(number+
2)),this.finest=finestOf(alone,this.finest),this.dressShapes(first),this.ask()}layersOf({points,triangles,edges,prints,grounds,far={xyz:new Float32Array(0),building:new Uint32Array(
0),epochs:new Uint8Array(0),count:0}}){let{painter}=this;return{grounds:grounds.map(({position})=>painter.add("triangles",position,new Uint32Array(position.length/
3),{shaded:!0})),models:painter.add("triangles",triangles.xyz,repeated(triangles.building,3),{shaded:!0,strength:.25}),far:painter.add("triangles",far.xyz,repeated(
far.building,3),{shaded:!0,strength:.25}),edges:painter.add("lines",edges.xyz,repeated(edges.building,2),{strength:1,minor:!0,fades:!0}),prints:painter.add("lin\
es",prints.xyz,repeated(prints.building,2),{strength:1,minor:!0}),points:painter.add("points",points.xyz,Uint32Array.from(points.building)),other:painter.add("p\
oints",points.xyz,new Uint32Array(points.count),{opacity:OTHER_OPACITY})}}async addImage(address){let image=new Image,{rows,columns,cell,west,north}=page.terrain,
[wide,tall]=[columns*cell,rows*cell];image.src=address,await image.decode(),this.painter.picture(image,[-west/wide,1/wide,0,0,0,0,north/tall,0,-1/tall,0,0,0]),frameOf(
"basemap").hidden=!1}checked(name){return field(name).checked}refresh(){let{scene,painter,layers}=this,{points,grounds}=scene;this.look.background=shade("--sky").
map(value=>value/255),this.look.mark=shade("--mark").map(value=>value/255),this.look.only=this.checked("only");let size=Number(field("size").value);this.look.pointSize=
.35*size;let earth=shade("--earth");layers.grounds.forEach((layer,place)=>{let{position,light,details,epoch}=grounds[place],count2=position.length/3;layer.pictured=
!!painter.lay&&this.checked("basemap"),this.dress(layer,{epochs:new Uint8Array(count2).fill(epoch),count:count2},1,()=>layer.pictured?[255,255,255]:earth,vertex=>this.
look.only?1:light[vertex]),painter.show(layer,...this.checked("ground")?details:[new Uint32Array(0)])});let pointWay=pointColours(field("point-colour").value,scene),
[on,under,other]=["points-building","points-ground","points-other"].map(name=>this.checked(name)),foreign=number=>!points.building[number]&&points.classification[number]!==
2,{epochs,count}=points;this.dress(layers.points,{epochs,count},1,number=>!foreign(number)&&(points.building[number]?on||points.building[number]===this.look.chosen:
under)?pointWay.at(number):null),this.dress(layers.other,{epochs,count},1,number=>foreign(number)&&other&&!this.look.only&&!points.over[number]?pointWay.at(number):
null),this.dressShapes(),legend(byId("point-legend"),layers.points.shown.length+layers.other.shown.length?pointWay.legend:{text:"no points are shown"}),this.ask()}dressShapes(first={
triangles:0,edges:0,prints:0}){let{scene,painter,layers}=this,{triangles,edges,prints}=scene,line=shade("--line"),outline=shade("--outline"),wantedLod=page.lods.
indexOf(field("lod").value),shown=(things,number)=>things.lod[number]===BOX||things.lod[number]===(wantedLod<0?this.finest[modelOf(things,number)]:wantedLod),modelWay=modelColours(
field("model-colour").value,scene),scale=JSON.stringify(modelWay.legend);scale!==this.scale&&Object.assign(first,{triangles:0}),this.scale=scale;let[roofs,walls]=[
this.checked("roofs"),this.checked("walls")],red=bytes(LOD_COLOURS.none);if(this.dress(layers.models,triangles,3,number=>{let row=triangles.building[number],kind=triangles.
kind[number];return!shown(triangles,number)||!(kind===2?roofs:walls)?null:triangles.lod[number]===0&&wantedLod<0&&page.modelled?red:modelWay.at(number,row-1)},(vertex,number)=>triangles.
kind[number]===1?wallShade(triangles.xyz[3*vertex+2]-this.spots[triangles.building[number]-1].low[2]):1,first.triangles),this.city&&scene.far){let all=layers.models.
shown,{building}=scene.far,roofOf=this.city.roofOf();painter.show(layers.models,all,all.filter(vertex=>triangles.lod[Math.floor(vertex/3)]!==BOX||triangles.kind[Math.
floor(vertex/3)]===2)),this.dress(layers.far,scene.far,3,number=>modelWay.at(roofOf[building[number]-1],building[number]-1)),layers.far.blocks=[],layers.models.
blocks=this.city.blocks(layers.models,layers.far,roofs)}this.dress(layers.edges,edges,2,number=>this.checked("edges")&&edges.lod[number]>0&&shown(edges,number)?
line:null,null,first.edges),this.dress(layers.prints,prints,2,()=>this.checked("prints")?outline:null,null,first.prints),legend(byId("model-legend"),modelWay.legend)}dress(layer,things,width,colour,bright=null,first=0){
let{epochs,count}=things;first||Object.assign(things,{dressed:new Uint8Array(4*count*width),seen:new Uint8Array(count)});let dressed=things.dressed,seen=things.
seen,list=new Uint32Array(count*width),end=0;for(let number=0;number<count;number++){let answer=number>=first?colour(number):null;if(answer){seen[number]=1;for(let vertex=number*
width;vertex<(number+1)*width;vertex++){let light=bright?bright(vertex,number):1;for(let band=0;band<3;band++)dressed[4*vertex+band]=light*answer[band];dressed[4*
vertex+3]=epochs[number]}}if(seen[number])for(let vertex=number*width;vertex<(number+1)*width;vertex++)list[end++]=vertex}this.painter.recolour(layer,dressed),this.
painter.show(layer,list.slice(0,end))}ask(){this.pace.ask()}address(){return addressOf(this)}obeyAddress(hash){obeyAddress(this,hash)}before(){return this.camera.
aspect=this.canvas.clientWidth/Math.max(1,this.canvas.clientHeight),this.look.split=this.epochs.share(),[this.camera,this.look]}after(quality){let counts=[this.
layers.points,this.layers.other].map(layer=>layer.shown.length),sum=(one,two)=>one+two,here=counts.reduce(sum),drawn=counts.map(count=>Math.min(count,QUALITIES[quality].
points)).reduce(sum);byId("moving").hidden=!quality,quality&&(byId("moving").textContent=`While it moves: ${drawn<here?`${drawn.toLocaleString("en")} of ${here.
toLocaleString("en")} points, `:""}${this.city?"buildings far away as one, ":""}coarser ground${QUALITIES[quality].lines?"":", no lines"}, lower resolution`),this.
measure(),!quality&&this.city&&this.city.look()}measure(){let step=this.camera.step(this.canvas.clientHeight),rough=120*step,power=10**Math.floor(Math.log10(rough)),
length=[5,2,1].map(times=>times*power).find(value=>value<=rough)||power;byId("scale").style.width=`${length/step}px`,byId("scale").textContent=`${length<1?length.
toFixed(1):length} m`,this.ruler.draw(),this.tools.draw(),byId("needle").style.transform=`rotate(${this.camera.azimuth}rad)`}fly(place){let{low,high}=boxOf(this.
scene),there=place.every((value,axis)=>value>=low[axis]&&value<=high[axis]);byId("answer").textContent=there?"at these coordinates":"these coordinates lie outsi\
de of what is shown",there&&(this.camera.flyTo([...place,this.camera.target[2]],15),this.refresh())}describe(number){describe(byId("building"),this.all[number],
number,this.scene)}choose(number,fly=!0){this.tell(number,fly),this.refresh()}tell(number,fly){let row=this.all[number],spot=this.spots[number];if(this.look.chosen=
spot?number+1:0,byId("building").hidden=!row,byId("hint").hidden=!!row,this.verdicts.choose(row),field("find").value=row?row.id:"",document.documentElement.dataset.
chosen=row?row.id:"",row){this.describe(number);let side=byId("controls"),top=byId("building").offsetTop-side.offsetTop;if(top>side.scrollTop+side.clientHeight-
200&&(side.scrollTop=top-8),byId("status").textContent=`building ${row.id} chosen${spot?"":", which is not drawn"}`,fly&&spot&&Number.isFinite(spot.low[0])){let{
low,high}=spot;this.camera.flyTo(low.map((value,axis)=>(value+high[axis])/2),Math.hypot(high[0]-low[0],high[1]-low[1],high[2]-low[2])/2)}}this.table?.mark(row?number:
-1);for(let done of this.tools?.choosers??[])done(row?number:-1,row)}view(name){let{camera,look}=this;name==="above"?camera.above(!look.chosen):name==="side"?camera.
side(this.quarter=(this.quarter+1)%4):name==="north"?camera.azimuth=0:name==="oblique"?Object.assign(camera,{flat:!1,elevation:.75}):(camera.reset(),this.quarter=
-1),name==="side"&&look.chosen&&this.choose(look.chosen-1),this.ask()}};var NAMES_OFFERED=4e3;async function start(){let viewer=null,city=null,all=[];try{city=page.city?await City.open():null,all=city?city.rows:page.rows.concat(await unpackRows(
page.others))}catch(error){return trouble(error)}let rows=city?all:page.rows;try{viewer=new Viewer(city?city.scene():{...readScene(await unpackAll(page.arrays)),
rows},all),page.basemap&&await viewer.addImage(page.basemap),city&&await city.follow(viewer),listenToCanvas(viewer),listenToControls(viewer),listenToPrint(viewer),
keepAddress(viewer),obeyAddress(viewer),window.eaves=viewer,addEventListener("hashchange",()=>obeyAddress(window.eaves)),await viewer.pace.first()}catch(error){
trouble(error)}let table=new Table(byId("buildings"),page.columns,all,number=>{viewer&&(viewer.choose(number),byId("scene").scrollIntoView({block:"nearest"}))});
drawCharts(byId("charts"),all),byId("ids").append(...rows.slice(0,NAMES_OFFERED).map(row=>element("option",{value:row.id}))),document.documentElement.dataset.ready||
(document.documentElement.dataset.ready="yes"),viewer&&(viewer.table=table,table.mark(viewer.look.chosen-1),beginExtensions(viewer.tools))}function trouble(error){
byId("trouble").textContent=`No 3D view: ${messageOf(error)}.`,byId("trouble").hidden=!1,document.documentElement.dataset.ready="no"}start();})();
